"""The process before a Zenoh router that owns its public port."""

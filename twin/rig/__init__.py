"""The simulator process of a rig: slots, engine, and what each slot leaves behind."""

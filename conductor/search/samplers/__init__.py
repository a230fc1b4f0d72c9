"""The samplers that are shipped (:mod:`schemas.kinds.sampler`)."""

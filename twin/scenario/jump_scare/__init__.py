"""A broken-down car stands in the ego's lane: does the ego stop for it?"""

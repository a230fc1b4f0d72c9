"""Roads as flat tables, and the functions with which kernels walk on them."""

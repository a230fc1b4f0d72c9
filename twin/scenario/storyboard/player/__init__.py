"""The player of storyboard programs: flat tables and the kernels that interpret them."""

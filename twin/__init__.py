"""The simulator: world, vehicle, sensors, renderer, KPIs and the worker that runs rigs of them."""

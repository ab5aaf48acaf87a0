"""The network: model store, samplers and the engine that owns the device. Torch lives here only."""

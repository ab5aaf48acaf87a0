"""The network: model store, solvers, and the engine that owns the device. PyTorch lives here."""

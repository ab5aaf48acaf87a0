"""The network as compiled vector code."""

"""Offline training: prior -> data set -> U-Net -> EMA -> checkpoint in a model store."""

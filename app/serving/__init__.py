"""The service without HTTP: from a request to an answer, whoever asks."""

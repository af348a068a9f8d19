"""The scene of a flight: a viser server with the aircraft's attitude and the risk."""

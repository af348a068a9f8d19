"""Read recorded telemetry: from a file to channels in SI units on the monitor's time grid."""

"""IRIG 106 Chapter 10: packets, and the numbers in them."""

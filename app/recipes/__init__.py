"""Recipes as plain data and back, with their words for people."""

"""A run on one page: what its folder holds as plots, tables and pictures that need no network."""

"""What needs a checkout: results, the model that comes with the package, pictures, conversions."""

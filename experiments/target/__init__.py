"""What the nets must be good on: real images, or a twin where there are none."""

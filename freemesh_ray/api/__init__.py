"""What programs call to train and to study; ``freemesh_ray`` names it. The commands call the same."""

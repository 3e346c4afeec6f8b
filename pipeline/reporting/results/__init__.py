"""What the stages left in the artifacts folder, read back."""

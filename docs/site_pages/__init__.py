"""What the documentation site derives from the code and from the files of the repository."""

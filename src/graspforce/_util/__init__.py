"""What several parts of the package share and nobody else needs."""

"""Text that people and other programs write: YAML with line numbers, tables, encodings; small HTML tables."""

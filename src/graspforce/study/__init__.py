"""The paper and its rivals studied: figures, comparison, timing, and the report of it all."""

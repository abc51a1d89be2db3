"""The FMI shell: port declarations, model descriptions, code generation and packing."""

"""The commands; a module with a constant ``COMMAND`` appears in `bench-service` by itself."""

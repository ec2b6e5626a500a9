"""The recorder: the one process that writes samples."""

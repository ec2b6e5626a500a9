"""The battery test bench service."""

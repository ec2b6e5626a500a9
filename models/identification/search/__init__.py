"""Which structure to take: candidates, and the held-out error by which they are judged."""

from models.identification.search.candidate import Choice
from models.identification.search.search import Search

__all__ = ["Choice", "Search"]

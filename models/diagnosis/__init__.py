"""Which physical effect is missing, or new, with evidence."""

from models.diagnosis.addition import Addition, add_effect
from models.diagnosis.diagnosis import MEMORY, diagnose, memory_of
from models.diagnosis.findings import Diagnosis, Finding

__all__ = ["MEMORY", "Addition", "Diagnosis", "Finding", "add_effect", "diagnose", "memory_of"]

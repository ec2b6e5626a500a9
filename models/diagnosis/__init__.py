"""Which physical effect is missing in a model, or new in its cell, with evidence."""

from models.diagnosis.answer.findings import Diagnosis, Finding
from models.diagnosis.diagnosis import diagnose, memory_of, own_variant
from models.diagnosis.known.fitting import likely_soc
from models.diagnosis.known.record import to_json as memory_to_json

__all__ = ["Diagnosis", "Finding", "diagnose", "likely_soc", "memory_of", "memory_to_json", "own_variant"]

"""State-of-charge estimation with the local model network: the fuzzy observer and its tuning."""

from models.observer.filter.fuzzy_observer import FuzzyObserver, ObserverOutput
from models.observer.filter.settings import ObserverSettings, default_settings

__all__ = ["FuzzyObserver", "ObserverOutput", "ObserverSettings", "default_settings"]

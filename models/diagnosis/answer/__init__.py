"""From evidence to an answer: verdict, findings, confidence, explanation, next experiment."""

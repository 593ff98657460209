"""Answers as a search would leave them, for tests of what is made of one."""

from collections.abc import Mapping

from wakedeploy.gap.search.artefacts import Answer, Effect, Forecast, Sizes


def answer_with(verdict: str, effects: Mapping[str, Sizes], constants: Sizes) -> Answer:
    """One of a made-up system, with nothing in it but a verdict, effects and constants."""
    gains = Forecast(share=0.5, low=0.4, high=0.6)
    return Answer.model_validate(
        {
            "domain": "made",
            "verdict": verdict,
            "class": [],
            "threshold_nats": 3.0,
            "effects": [
                Effect(name=name, parameters=sizes, forecast=gains)
                for name, sizes in effects.items()
            ],
            "parameters": {},
            "constants": constants,
            "noise": {},
            "rounds": [],
            "unsettled": [],
            "sealed_gain_nats": 0.0,
        }
    )

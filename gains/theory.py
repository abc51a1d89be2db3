"""What a certificate consists of: a model, a gain, a proof, and the inequalities that they have to fulfil."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

#: Functions of (model, gain, proof).
Matrices = Callable[[Any, Any, Any], dict[str, Any]]
Figures = Callable[[Any, Any, Any], dict[str, Any]]


def no_limits(proof: Any, figures: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """For theories whose inequalities say everything."""
    return {}


@dataclass(frozen=True)
class Theory:
    """How gains of one kind are proved."""

    name: str
    statement: str  #: what is proved, in words
    model: type[Any]  #: dataclass of the model
    proof: type[Any]  #: dataclass of the proof
    inequalities: Matrices  #: matrices that must be positive definite; also of fractions
    figures: Figures  #: numbers to know; raises LinAlgError if they are not finite
    formulas: tuple[Callable[..., Any], ...]  #: functions whose docstrings explain the inequalities
    #: from proof and figures: (value, limit) of what must stay below a limit but is no inequality of matrices
    limits: Callable[[Any, dict[str, Any]], dict[str, tuple[float, float]]] = no_limits


@dataclass(frozen=True)
class Subject:
    """What a certificate is about: an error model of the vehicle, and a gain taken from the diagnoser's parameters."""

    theory: Theory
    model: Any
    gain: Any


@dataclass(frozen=True)
class Certificate:
    """A subject with its proof, and the figures that follow."""

    name: str
    theory: Theory
    model: Any
    proof: Any
    figures: dict[str, Any]

    @classmethod
    def of(cls, name: str, subject: Subject, proof: Any) -> Certificate:
        """Certificate with its figures computed."""
        figures = subject.theory.figures(subject.model, subject.gain, proof)
        return cls(name, subject.theory, subject.model, proof, figures)

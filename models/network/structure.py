"""What a local model network looks like: inputs, orders, partition; frozen data that can be written down."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from models.data.errors import StructureError
from models.network.signals import is_soc, parse_signal

# Compiled functions (njit) know kernels by their places here.
KERNELS = ("gaussian", "uniform", "triangular", "hat")
# Of the temperature axis, where temperature moves (ch. 2.2.3.3).
TEMPERATURE_PARTS = 3


@dataclass(frozen=True)
class InputChannel:
    """One input of the local models: taps u(k - delay) ... u(k - delay - order).

    `signal` is a signal's name as in `signals`, with its parameters after a colon ("relaxation:60").
    """

    signal: str
    order: int = 0
    delay: int = 0

    def __post_init__(self) -> None:
        """Check the name and the taps."""
        parse_signal(self.signal)
        if self.order < 0 or self.delay < 0:
            raise StructureError(f"input {self.signal}: order {self.order} and delay {self.delay} must not be negative")

    @property
    def taps(self) -> int:
        """Number of regressors that this input adds."""
        return self.order + 1


@dataclass(frozen=True)
class PartitionAxis:
    """One dimension of the partition space.

    Attributes
    ----------
    signal : name of the partition variable
    initial : equal parts that it is divided into before construction begins (eq. 2.5 ff., prepartitioning)
    splittable : whether construction may divide it further
    k_sigma : sharpness; the kernel's standard deviation over the part's width (eq. 2.6)
    """

    signal: str
    initial: int = 1
    splittable: bool = True
    k_sigma: float = 0.4

    @property
    def held(self) -> bool:
        """Whether the partition variable is held at the edges of the trained range (`inside_trained`)."""
        return parse_signal(self.signal).definition.of_temperature

    def __post_init__(self) -> None:
        """Check ranges."""
        parse_signal(self.signal)
        if self.initial < 1 or not 0.0 < self.k_sigma <= 10.0:
            raise StructureError(
                f"partition axis {self.signal}: initial {self.initial} must be at least 1 and "
                f"k_sigma {self.k_sigma:g} within 0..10"
            )


@dataclass(frozen=True)
class Structure:
    """A network's structure.

    Attributes
    ----------
    output_order : n, the past outputs that each local model uses (0: none)
    inputs : the input space
    axes : the partition space
    dt_s : sampling time of the discrete-time model in s
    kernel : one of KERNELS; "hat": straight lines between knots along one state of charge, without past outputs
    name : what a person calls it
    """

    output_order: int
    inputs: tuple[InputChannel, ...]
    axes: tuple[PartitionAxis, ...]
    dt_s: float
    kernel: str = "gaussian"
    name: str = "custom"

    def __post_init__(self) -> None:
        """Check that the parts fit together."""
        if not 0 <= self.output_order <= 2:
            raise StructureError(f"output order {self.output_order}; 0, 1 or 2 is supported")
        if self.kernel not in KERNELS:
            raise StructureError(f"kernel {self.kernel!r}; one of {', '.join(KERNELS)} is needed")
        if not 0.0 < self.dt_s < 1e6:
            raise StructureError(f"sampling time {self.dt_s:g} s must be positive and finite")
        if not self.inputs or not self.axes:
            raise StructureError("a network needs at least one input and one partition variable")
        if self.kernel == "hat":
            self._check_hats()

    def _check_hats(self) -> None:
        """Hats interpolate along one state of charge, and leave no room for past outputs."""
        axes = ", ".join(axis.signal for axis in self.axes)
        if len(self.axes) != 1 or not is_soc(self.axes[0].signal):
            raise StructureError(f"kernel 'hat' needs one partition axis along a state of charge; the axes are {axes}")
        if self.output_order != 0:
            raise StructureError(f"kernel 'hat' needs output order 0, without past outputs; it is {self.output_order}")

    @property
    def n_regressors(self) -> int:
        """Parameters of one local model: past outputs, input taps and the offset."""
        return self.output_order + sum(channel.taps for channel in self.inputs) + 1

    @property
    def signals(self) -> tuple[str, ...]:
        """All signals that inputs and axes use, each once, in order."""
        return tuple(dict.fromkeys([*(c.signal for c in self.inputs), *(a.signal for a in self.axes)]))

    @property
    def soc_axis(self) -> int:
        """Number of the partition axis along the state of charge, -1 where there is none."""
        return next((i for i, axis in enumerate(self.axes) if is_soc(axis.signal)), -1)

    def taps(self) -> list[tuple[str, int]]:
        """Signal and delay of each input regressor, in the order of the parameters after the past outputs."""
        return [(c.signal, c.delay + tap) for c in self.inputs for tap in range(c.taps)]

    def soc_regressors(self) -> list[int]:
        """Regressors that carry the state of charge of the sample before."""
        found = [i for i, (signal, lag) in enumerate(self.taps()) if is_soc(signal) and lag == 1]
        return [self.output_order + i for i in found]

    def regressor_names(self) -> tuple[str, ...]:
        """Names of one local model's regressors, in the order of its parameters."""
        past = [f"voltage(k-{lag})" for lag in range(1, self.output_order + 1)]
        return (*past, *(f"{signal}(k-{lag})" for signal, lag in self.taps()), "1")

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        return asdict(self)

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Structure:
        """Read what `to_json` wrote.

        Raises
        ------
        StructureError
            A key is missing or unknown, or a value is out of range.
        """
        try:
            fields = dict(document)
            fields["inputs"] = tuple(InputChannel(**channel) for channel in fields["inputs"])
            fields["axes"] = tuple(PartitionAxis(**axis) for axis in fields["axes"])
            return cls(**fields)
        except (KeyError, TypeError) as error:
            raise StructureError(f"not a network structure: {error}") from None


def minimal_structure(dt_s: float, output_order: int = 1, current_order: int = 1, k_sigma: float = 0.5) -> Structure:
    """Inputs SoC and current, partition in SoC only."""
    return Structure(
        output_order=output_order,
        inputs=(InputChannel("soc", delay=1), InputChannel("current", order=current_order)),
        axes=(PartitionAxis("soc", k_sigma=k_sigma),),
        dt_s=dt_s,
        name="minimal",
    )


def full_structure(
    dt_s: float,
    output_order: int = 1,
    current_order: int = 1,
    relaxation_s: float = 600.0,
    k_sigma: float = 0.5,
    temperature_k_sigma: float = 0.6,
    temperature_parts: int = TEMPERATURE_PARTS,
) -> Structure:
    """Return the method's structure (eq. 2.8): inputs SoC, current, relaxation; partition SoC, hysteresis, temperature.

    Prepartitioned 2 x 3 over hysteresis and temperature, split in SoC only (ch. 2.2.3.3); `temperature_parts` are fewer
    where no run was in one of them. The SoC enters with one sample of delay, because the observer's state matrix
    (eq. 2.36) multiplies SoC(k-1).
    """
    return Structure(
        output_order=output_order,
        inputs=(
            InputChannel("soc", delay=1),
            InputChannel("current", order=current_order),
            InputChannel(f"relaxation:{relaxation_s:g}"),
        ),
        axes=(
            PartitionAxis("soc", k_sigma=k_sigma),
            PartitionAxis("hysteresis", initial=2, splittable=False, k_sigma=0.25),
            PartitionAxis("temperature", initial=temperature_parts, splittable=False, k_sigma=temperature_k_sigma),
        ),
        dt_s=dt_s,
        name="full",
    )

"""The section `panels`: what the panels look like, and how each blinks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict
from datetime import date
from typing import Annotated

from pydantic import AfterValidator, Field, StrictBool

from ledpi.config.values import Duty, Hertz, MarkerId, Section, SideM, check_cycles_fit
from ledpi.core.codewords import Dictionary, format_ranges
from ledpi.core.dictionaries import FILE_ENDINGS, dictionary_names, is_file, load_dictionary, meant_name
from ledpi.core.errors import ConfigError, raising
from ledpi.core.records import PanelSpec, PanelValues, Phase


def _known_dictionary(name: str) -> str:
    if name in dictionary_names() or is_file(name):
        return name
    known, endings = ", ".join(dictionary_names()), ", ".join(FILE_ENDINGS)
    raise ValueError(f"{meant_name(name)}must be one of {known}, or a file that ends in {endings}")


def _each_once(ids: tuple[int, ...]) -> tuple[int, ...]:
    twice = sorted(listed for listed, times in Counter(ids).items() if times > 1)
    if twice:
        raise ValueError(f"must list each ID once, and lists {format_ranges(twice)} twice")
    return ids


class PanelOverride(Section):
    """An entry of `panels.overrides`: what is other than of the common panel."""

    side_m: SideM | None = None
    black_hz: Hertz | None = None
    white_hz: Hertz | None = None
    duty: Duty | None = None
    phase: Phase | None = None
    measured: date | None = None  # by `ledpi calibrate panel`


class PanelSettings(Section):
    """The section `panels`."""

    dictionary: Annotated[str, AfterValidator(_known_dictionary)] = "DICT_4X4_50"
    side_m: SideM
    black_hz: Hertz = 1250.0
    white_hz: Hertz = 2450.0
    duty: Duty = 0.5
    phase: Phase = "free"
    upright: StrictBool = False  # all hang with their y axis up, on walls
    # Those that exist. None: all but those that a part or a reflection of a panel can show.
    ids: Annotated[tuple[MarkerId, ...], Field(min_length=1), AfterValidator(_each_once)] | None = None
    search_frequencies: StrictBool = False  # of oscillators that are off by a percent, as RC oscillators are
    overrides: dict[MarkerId, PanelOverride] = Field(default_factory=dict)

    @property
    def words(self) -> Dictionary:
        """The dictionary, loaded. Raises ValueError for one that is not known, or a file that cannot be read."""
        return load_dictionary(self.dictionary)

    def spec(self, marker_id: int | None = None) -> PanelSpec:
        """The panel of one ID, or, without an ID, the common one. Raises ValueError where they contradict."""
        values = self.model_dump(include={"side_m", "black_hz", "white_hz", "duty", "phase"})
        if marker_id is not None and marker_id in self.overrides:
            values |= self.overrides[marker_id].model_dump(exclude_none=True, exclude={"measured"})
        return PanelSpec(**values)

    def existing_ids(self) -> frozenset[int]:
        """The IDs that may be reported: `ids`, or else all but those that a part or a reflection of a panel can show.

        Raises ValueError for an unknown dictionary, and for one that has no other.
        """
        if self.ids is not None:
            return frozenset(self.ids)
        dictionary = self.words
        like = {
            *dictionary.part_like_ids(),
            *(i for phase in self._phases() for i in dictionary.reflection_like_ids(phase)),
        }
        existing = frozenset(range(len(dictionary.codewords))) - like
        if not existing:
            raise ValueError(
                f"a part or a reflection of a panel can show each ID of {self.dictionary}, so none would be reported; "
                "panels.ids must list the panels that exist"
            )
        return existing

    def unreported_note(self, ids: Iterable[int]) -> str:
        """Names those of `ids` that the dictionary has, and that are not reported; "" where all are."""
        known = range(len(self.words.codewords))
        missing = sorted(set(ids).intersection(known) - self.existing_ids())
        if not missing:
            return ""
        one = len(missing) == 1
        ids_are = f"{'ID' if one else 'IDs'} {format_ranges(missing)} {'is' if one else 'are'}"
        note = f"{ids_are} reported only if panels.ids lists {'it' if one else 'them'}"
        return note if self.ids is not None else f"{note}: a part or a reflection of a panel can look the same"

    def reflection_note(self) -> str:
        """Names those of `ids` that one of them shows in a mirror; "" where none does, as where `ids` is not set."""
        if self.ids is None:
            return ""
        dictionary, listed = self.words, sorted(set(self.ids))
        own = Dictionary(name=self.dictionary, codewords=dictionary.codewords[listed])
        like = sorted({listed[k] for phase in self._phases() for k in own.reflection_like_ids(phase)})
        if not like:
            return ""
        return f"a mirror, window or glossy floor can show {format_ranges(like)} where there is no such panel"

    def frequencies_hz(self) -> tuple[float, ...]:
        """Every frequency that a panel blinks at, sorted. Raises ValueError where the panels' values contradict."""
        return tuple(sorted({hz for spec in self._specs() for hz in spec.waves_hz}))

    def override_with(self, values: PanelValues) -> PanelSettings:
        """With a recording's own values for the common ones. Raises ConfigError where overrides contradict them."""
        panels = self.model_copy(update=asdict(values))
        try:
            panels.frequencies_hz()
        except ValueError as error:
            own = panels.spec().blinking()
            raise ConfigError(f"panels.overrides: contradict the recording's own panel, of {own}: {error}") from None
        with raising("panels.ids", ConfigError):
            panels.existing_ids()
        return panels

    def has_antiphase(self) -> bool:
        """Tells whether the classes of any panel blink in antiphase."""
        return "antiphase" in self._phases()

    def _phases(self) -> set[Phase]:
        return {spec.phase for spec in self._specs()}

    def _specs(self) -> list[PanelSpec]:
        return [self.spec(), *(self.spec(marker_id) for marker_id in self.overrides)]


def check_panels(panels: PanelSettings, where: str) -> None:
    """Values that are right one by one may contradict each other, or the dictionary."""
    with raising(f"{where}: panels.dictionary", ConfigError):
        dictionary = panels.words
    known = len(dictionary.codewords)
    beyond = [listed for listed in panels.ids or () if listed >= known]
    if beyond:
        has = f"{panels.dictionary} has only the IDs 0 to {known - 1}"
        raise ConfigError(f"{where}: panels.ids: {has}, not {beyond[0]}")
    for marker_id in (None, *panels.overrides):
        key = "panels" if marker_id is None else f"panels.overrides.{marker_id}"
        if marker_id is not None and marker_id >= known:
            raise ConfigError(f"{where}: {key}: {panels.dictionary} has only the IDs 0 to {known - 1}")
        with raising(f"{where}: {key}", ConfigError):
            spec = panels.spec(marker_id)
            if marker_id is not None:
                dictionary.check_readable(marker_id, spec.phase)
            elif not dictionary.readable_ids(spec.phase):
                raise ValueError(dictionary.none_readable(spec.phase))
    with raising(f"{where}: panels.ids", ConfigError):
        panels.existing_ids()


def check_bands_visible(panels: PanelSettings, row_time_us: float, where: str) -> None:
    """Raises ConfigError where no picture with such rows shows how panels blink."""
    with raising(f"{where}: panels", ConfigError):
        check_cycles_fit(panels.frequencies_hz(), row_time_us)

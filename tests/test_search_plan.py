"""When a picture is searched, and how thoroughly."""

from __future__ import annotations

from ledpi.search_plan import SearchPlan


def searched(plan: SearchPlan, *, all_seen: bool, read: bool, read_before: bool = True) -> str:
    """How one frame is searched: not, once, again, and within."""
    begins = plan.begins(all_seen=all_seen)
    within = plan.looks_within(read=read, read_before=read_before)
    return "s" * begins + "a" * plan.goes_on(read=read) + "w" * within


def test_while_all_panels_are_seen_every_third_frame_is_searched_for_newcomers() -> None:
    """And in every fourth of these searches also for what is only bright for its surroundings."""
    plan = SearchPlan()
    assert [searched(plan, all_seen=True, read=True) for _ in range(12)] == ["", "", "s"] * 3 + ["", "", "sa"]


def test_while_nothing_is_read_every_frame_is_searched_and_every_third_within() -> None:
    """For panels that were read before: what is within them takes longest to be looked at."""
    plan = SearchPlan()
    assert [searched(plan, all_seen=False, read=False) for _ in range(6)] == ["sa", "sa", "saw"] * 2


def test_where_nothing_was_read_before_nothing_is_looked_within() -> None:
    """Lines alone are not believed."""
    plan = SearchPlan()
    assert {searched(plan, all_seen=False, read=False, read_before=False) for _ in range(6)} == {"sa"}

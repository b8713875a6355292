"""Finds one run of a store, to repeat it."""

from __future__ import annotations

from pathlib import Path

from soter.campaign.job import Job
from soter.campaign.plan import Campaign, load_campaign
from soter.campaign.store import RunRow, Store
from soter.errors import ConfigError


def find(store: Store, name: str) -> RunRow:
    """Return the run whose id begins with `name`.

    Raises:
        ConfigError: there is no such run, or more than one.
    """
    found = [each for each in sorted(store.ids()) if each.startswith(name)]
    if len(found) != 1:
        raise ConfigError(f"it is '{name}', of which there are {len(found)} in {store.path}, allowed: one", key="ID")
    return next(store.rows(run=found[0]))


def campaign_of(store: Store) -> Campaign:
    """Return the campaign of a store.

    Raises:
        ConfigError: the campaign's file is gone or wrong.
    """
    return load_campaign(Path(store.about()["path"]))


def job_of(store: Store, row: RunRow) -> Job:
    """Return the job of a run.

    Raises:
        ConfigError: the store's campaign is gone, or one of the sources of its runs has changed.
    """
    campaign, sources = campaign_of(store), store.about()["sources"]
    if campaign.sources != sources:
        raise ConfigError(
            f"it was made of other sources ({sources}; now {campaign.sources}): the code, a mission or a library has "
            "changed since, and it would be another run",
            source=str(store.path),
        )
    return campaign.job(campaign.parts[row.part], row.number, dict(row.settings), row.axes)

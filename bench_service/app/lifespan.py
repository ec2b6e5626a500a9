"""Starts the parts of the service in their order, and stops them in the reverse one."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager, closing
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar

from bench_service.app.recorder import RecorderKeeper
from bench_service.app.simulated import SimulatedCycler, simulator_arguments
from bench_service.bench.direct.ticket import StopEndpoint, own_origins
from bench_service.bench.limits import Limits
from bench_service.bench.messages import EventMessage
from bench_service.bench.settings import BenchSettings
from bench_service.bench.supervisor import BenchSupervisor
from bench_service.campaign.aside import Aside
from bench_service.campaign.benches import Bench, Benches
from bench_service.campaign.campaigns import CampaignRunner
from bench_service.campaign.cell_on_bench import settings_with, with_cell
from bench_service.campaign.cells import Cells, cell_on
from bench_service.campaign.clock_watch import watched_clock
from bench_service.campaign.commissioning import Commissioning
from bench_service.campaign.designing import Designing
from bench_service.campaign.devices import Devices
from bench_service.campaign.diagnosing import Diagnosing
from bench_service.campaign.endings import close_left_open
from bench_service.campaign.hardware import Hardware
from bench_service.campaign.importing import Importing
from bench_service.campaign.journal import Journal
from bench_service.campaign.latches import unacknowledged
from bench_service.campaign.learning import Learning
from bench_service.campaign.live import Broadcaster
from bench_service.campaign.modelling import Modelling
from bench_service.campaign.observing import Observing
from bench_service.campaign.protocol_resumer import ProtocolResumer
from bench_service.campaign.reporting import Made, Reporting
from bench_service.campaign.resuming import resumed_soc
from bench_service.campaign.runs import Runs
from bench_service.campaign.seal import Seal
from bench_service.campaign.services import Services
from bench_service.campaign.storage import Storage
from bench_service.campaign.trending import Trending
from bench_service.campaign.webhook import Webhook
from bench_service.campaign.workshop import Workshop
from bench_service.config import BenchConfig, ServiceConfig
from bench_service.jobs.runner import JobRunner
from bench_service.jobs.screening import Screen
from bench_service.store.interrupted import mark_interrupted_runs
from bench_service.store.metadata import MetadataStore
from bench_service.store.samples import SampleReader
from bench_service.store.views import Views
from bench_service.store.watch import MEGABYTE

_SEALS = "seals"  # in the data directory
ClosingT = TypeVar("ClosingT", Runs, CampaignRunner, Learning, ProtocolResumer)


@asynccontextmanager
async def running_services(
    config: ServiceConfig, store: MetadataStore, url: str | None = None
) -> AsyncIterator[Services]:
    """Give the running parts of the service; leaving brings every bench to rest and stores everything first.

    Parameters
    ----------
    config, store : the store is open, and closed by the caller
    url : str or None
        At which the service's page is opened; it may use the benches' stop ports.

    Raises
    ------
    StoreError, SimulationError : recorder or simulator cannot start
    """
    code_version = version("bench-service")
    async with AsyncExitStack() as stack:
        live, samples = Broadcaster(), stack.enter_context(closing(SampleReader(config.data_dir)))
        journal = await _journal(stack, store, live)
        await _webhook(stack, config, store, journal, {"version": code_version, "address": url})
        recorder = await _recorder(stack, config.data_dir, journal)
        storage = await _storage(stack, config, recorder, store, samples, journal)
        await _end_what_was_left_open(store, samples, journal)
        jobs = await _jobs(stack, config)
        runs, devices = _closed_by(stack, Runs(store, samples, journal, storage, code_version)), Devices(store, journal)
        benches = Benches(live, journal.note, runs.on_ended, runs.on_stop, runs.on_state, devices.on_state)
        stop = partial(StopEndpoint, config.data_dir, origins=own_origins(url))
        await _add_benches(stack, config, store, (samples, recorder, benches, devices, config.data_dir / _SEALS, stop))
        workshop = _workshop(store, samples, benches, runs, jobs, (config.data_dir, code_version))
        campaigns = _campaigns(stack, workshop, journal, live, code_version)
        await asyncio.gather(*(bench.supervisor.start() for bench in benches))
        await campaigns.resume_by_policy()
        _resume_protocols(stack, runs, benches, ProtocolResumer(store, runs, benches, journal.note))
        yield Services(
            config=config,
            version=code_version,
            store=store,
            samples=samples,
            views=Views(samples),
            journal=journal,
            benches=benches,
            runs=runs,
            jobs=jobs,
            screen=stack.enter_context(closing(Screen())),
            aside=stack.enter_context(closing(Aside())),
            modelling=workshop.modelling,
            observing=Observing(store, jobs, workshop.modelling, config.data_dir),
            learning=_learning(stack, workshop, journal, (config.data_dir, code_version)),
            diagnosing=workshop.diagnosing,
            designing=workshop.designing,
            trending=(trending := Trending(store, jobs, workshop.modelling, config.data_dir)),
            campaigns=campaigns,
            live=live,
            recorder_state=lambda: recorder.state,
            storage=storage,
            cells=Cells(store, journal, benches, runs, campaigns),
            commissioning=Commissioning(store, journal, benches, runs, campaigns, code_version),
            importing=Importing(store, jobs, storage, recorder.attach, (config.data_dir, code_version), config.readers),
            reporting=_reporting(workshop, trending, (config.data_dir, code_version)),
        )


def _closed_by(stack: AsyncExitStack, part: ClosingT) -> ClosingT:
    stack.push_async_callback(part.close)
    return part


def _campaigns(
    stack: AsyncExitStack, workshop: Workshop, journal: Journal, live: Broadcaster, code_version: str
) -> CampaignRunner:
    return _closed_by(stack, CampaignRunner(workshop, journal, live, code_version))


def _reporting(workshop: Workshop, trending: Trending, made: tuple[Path, str]) -> Reporting:
    return Reporting(workshop.store, workshop.samples, Made(workshop.jobs, trending, workshop.designing), *made)


def _learning(stack: AsyncExitStack, workshop: Workshop, journal: Journal, made: tuple[Path, str]) -> Learning:
    return _closed_by(stack, Learning(workshop.store, workshop.jobs, workshop.modelling, workshop.runs, journal, made))


def _resume_protocols(stack: AsyncExitStack, runs: Runs, benches: Benches, resumer: ProtocolResumer) -> None:
    """Let protocols go on that were cut off with an earlier service, or are with a control process of this one."""
    runs.on_cut_off = _closed_by(stack, resumer).look
    for bench in benches:
        resumer.look(bench.name)


async def _jobs(stack: AsyncExitStack, config: ServiceConfig) -> JobRunner:
    jobs = JobRunner(config.workers, nice=config.worker_nice)
    await jobs.start()
    stack.push_async_callback(jobs.stop)
    return jobs


async def _journal(stack: AsyncExitStack, store: MetadataStore, live: Broadcaster) -> Journal:
    journal = Journal(store, live)
    stack.push_async_callback(journal.close)
    await stack.enter_async_context(watched_clock(journal))
    return journal


async def _webhook(
    stack: AsyncExitStack, config: ServiceConfig, store: MetadataStore, journal: Journal, told: dict[str, str | None]
) -> None:
    if config.webhook is not None:
        said = told | {"institution": config.institution}
        webhook = Webhook(config.webhook, config.data_dir, store, journal, said)
        await webhook.start()
        stack.push_async_callback(webhook.close)


def _workshop(
    store: MetadataStore, samples: SampleReader, benches: Benches, runs: Runs, jobs: JobRunner, made: tuple[Path, str]
) -> Workshop:
    modelling = Modelling(store, jobs, *made)
    diagnosing = Diagnosing(store, jobs, modelling, *made)
    return Workshop(store, samples, benches, runs, modelling, diagnosing, Designing(store, jobs, made[0]), jobs)


async def _recorder(stack: AsyncExitStack, data_dir: Path, journal: Journal) -> RecorderKeeper:
    recorder = RecorderKeeper(data_dir, lambda *told: journal.note(None, _recorder_event(*told)))
    await recorder.start()
    stack.push_async_callback(recorder.stop)
    return recorder


async def _storage(
    stack: AsyncExitStack,
    config: ServiceConfig,
    recorder: RecorderKeeper,
    store: MetadataStore,
    samples: SampleReader,
    journal: Journal,
) -> Storage:
    floor = int(config.free_floor_MB * MEGABYTE)
    storage = Storage(store, samples, journal, recorder.watch, lambda: recorder.state, floor)
    await storage.start()
    stack.push_async_callback(storage.close)
    return storage


async def _end_what_was_left_open(store: MetadataStore, samples: SampleReader, journal: Journal) -> None:
    """Write down what an earlier service left open; after the recorder has stored the last rows of the one before."""
    await close_left_open(store, journal)
    for run in await asyncio.to_thread(mark_interrupted_runs, store, samples):
        journal.note(run.bench, _interrupted_event(run.id, run.state))


async def _add_benches(
    stack: AsyncExitStack,
    config: ServiceConfig,
    store: MetadataStore,
    seen: tuple[SampleReader, RecorderKeeper, Benches, Devices, Path, Callable[[str], StopEndpoint]],
) -> None:
    benches = seen[2]
    benches.add([await _bench(stack, name, each, store, *seen) for name, each in config.bench.items()])
    stack.push_async_callback(_close_all, benches)


async def _bench(
    stack: AsyncExitStack,
    name: str,
    config: BenchConfig,
    store: MetadataStore,
    samples: SampleReader,
    recorder: RecorderKeeper,
    listener: Benches,
    devices: Devices,
    seals: Path,
    stop: Callable[[str], StopEndpoint],
) -> Bench:
    url, runs_before_cell, seal = config.url, 0, None
    simulator: SimulatedCycler | None = None
    if config.simulate is not None:
        soc = await asyncio.to_thread(resumed_soc, store, samples, name)
        if soc is not None:
            config = config.model_copy(update={"simulate": config.simulate.model_copy(update={"initial_soc": soc})})
            assert config.simulate is not None
        arguments, sealed_in = simulator_arguments(config.simulate, config.map, config.chamber), None
        if config.simulate.hidden_effect is not None:
            seals.mkdir(mode=0o700, parents=True, exist_ok=True)
            sealed_in = seals / f"{name}.json"
            arguments += ["--hidden-effect", config.simulate.hidden_effect, "--seal", str(sealed_in)]
        simulator = await SimulatedCycler.start(arguments)
        stack.push_async_callback(simulator.stop)
        url = simulator.address
        if simulator.late is not None:
            event = EventMessage(severity="warning", code="priority", text=f"simulator: {simulator.late}", run_id=None)
            listener.on_event(name, event)
        runs_before_cell = 0 if soc is not None else await asyncio.to_thread(store.runs.last_number)
        seal = Seal.read(sealed_in) if sealed_in is not None else None
    cell, since_utc = await asyncio.to_thread(cell_on, store, name)
    chamber_url = None if simulator is None else simulator.chamber
    settings = BenchSettings(
        name=name,
        url=url or "",
        map=config.map,
        timeout_s=config.timeout_s,
        watchdog_s=config.watchdog_s,
        external_interlock=config.external_interlock,
        latched=await asyncio.to_thread(unacknowledged, store, name),
        identity=await asyncio.to_thread(devices.known, name, config),
        **settings_with(with_cell(config, cell), chamber_url),
    )
    supervisor = BenchSupervisor(settings, recorder.attach, listener, stop(name))
    hardware = await asyncio.to_thread(Hardware.read, store, name, config)
    limits = Limits.from_json(config.limits.model_dump())
    bench = Bench(config, settings.url, limits, supervisor, runs_before_cell, seal, hardware, chamber_url)
    bench.carry(cell, since_utc)
    if simulator is not None:
        simulator.keep(bench, store, samples, listener)
    return bench


async def _close_all(benches: Benches) -> None:
    # All at once: each brings its cycler to rest, and none should wait for another.
    await asyncio.gather(*(bench.supervisor.close() for bench in benches))


def _recorder_event(severity: str, text: str) -> EventMessage:
    return EventMessage(severity=severity, code="recorder", text=text, run_id=None)


def _interrupted_event(run_id: str, state: str) -> EventMessage:
    text = f"the service ended in the middle of the run; it is listed as {state}"
    return EventMessage(severity="warning", code="service_restarted", text=text, run_id=run_id)

"""Live feed over a WebSocket: states, values, events."""

from __future__ import annotations

import asyncio
import json
from typing import Annotated

from fastapi import APIRouter, Query, WebSocket, WebSocketDisconnect

from bench_service.api.dependencies import ServicesOf
from bench_service.campaign.live import Message, Subscription, TooManyReadersError

router = APIRouter(tags=["live"])
_TRY_AGAIN_LATER = 1013
Pace = Annotated[float, Query(ge=0.0, le=60.0, allow_inf_nan=False)]


@router.websocket("/live")
async def live(socket: WebSocket, services: ServicesOf, every_s: Pace = 0.0) -> None:
    """Send the state of every bench, then whatever happens; a slow reader loses messages.

    Of the values of each bench one message in ``every_s`` is sent, the newest.
    """
    try:
        reader = services.live.subscribe(every_s)
    except TooManyReadersError as error:
        await socket.accept()
        await socket.close(_TRY_AGAIN_LATER, str(error))
        return
    try:
        await socket.accept()
        for bench in services.benches:
            await _send(socket, {"type": "bench"} | bench.summary())
        await _serve(socket, reader)
    finally:
        services.live.unsubscribe(reader)


async def _serve(socket: WebSocket, reader: Subscription) -> None:
    sending = asyncio.create_task(_forward(socket, reader))
    receiving = asyncio.create_task(_until_closed(socket))
    try:
        await asyncio.wait({sending, receiving}, return_when=asyncio.FIRST_COMPLETED)
    finally:
        sending.cancel()
        receiving.cancel()
        await asyncio.gather(sending, receiving, return_exceptions=True)


async def _forward(socket: WebSocket, reader: Subscription) -> None:
    while True:
        await _send(socket, await reader.get())


async def _until_closed(socket: WebSocket) -> None:
    # The feed takes no commands; reading is how a closed connection shows.
    try:
        while True:
            await socket.receive_text()
    except (WebSocketDisconnect, RuntimeError, KeyError):
        return


async def _send(socket: WebSocket, message: Message) -> None:
    await socket.send_text(json.dumps(message, allow_nan=False))

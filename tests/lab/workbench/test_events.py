"""News for the pages that are open."""

import asyncio
import json
import threading

from skhoid.lab.workbench import bench as events
from skhoid.lab.workbench.bench import News


def told(text):
    assert text.endswith("\n\n")
    return json.loads(text.removeprefix("data: "))


def test_every_page_is_told():
    news = News()

    async def listening():
        pages = [news.stream(), news.stream()]
        first = [told(await anext(page)) for page in pages]
        threading.Thread(target=news.tell, args=("state",), kwargs={"by": "one"}).start()
        second = [told(await anext(page)) for page in pages]
        news.close()
        rest = [[text async for text in page] for page in pages]
        return first, second, rest

    first, second, rest = asyncio.run(listening())
    assert first == [{"state": 0, "opening": 0}] * 2
    assert second == [{"state": 1, "opening": 0, "by": "one"}] * 2
    assert rest == [[], []]


def test_a_page_that_comes_later_hears_how_things_are():
    news = News()
    news.tell("state", "opening")
    news.tell("state", search={"share": 0.5, "words": "half"})

    async def listening():
        page = news.stream()
        found = told(await anext(page))
        await page.aclose()
        return found

    assert asyncio.run(listening()) == {"state": 2, "opening": 1}


def test_silence_is_kept_alive(monkeypatch):
    monkeypatch.setattr(events, "QUIET", 0.01)

    async def listening():
        page = News().stream()
        found = [await anext(page) for _ in range(3)]
        await page.aclose()
        return found

    first, *others = asyncio.run(listening())
    assert told(first)
    assert others == [": still here\n\n"] * 2


def test_a_page_that_sleeps_gets_the_newest(monkeypatch):
    monkeypatch.setattr(events, "MOST_WAITING", 3)
    news = News()

    async def listening():
        page = news.stream()
        await anext(page)
        for _ in range(10):
            news.tell("state")
        await asyncio.sleep(0.01)
        found = [told(await anext(page))["state"] for _ in range(4)]
        await page.aclose()
        return found

    assert asyncio.run(listening()) == [7, 8, 9, 10]


def test_after_the_end_nobody_listens():
    news = News()
    news.close()
    news.tell("state")

    async def listening():
        return [text async for text in news.stream()]

    assert asyncio.run(listening()) == []


def test_a_page_whose_loop_has_ended_is_no_matter():
    news = News()
    page = news.stream()

    async def first():
        return await anext(page)

    loop = asyncio.new_event_loop()
    loop.run_until_complete(first())
    loop.close()
    news.tell("state")
    news.close()

"""How quick the playground is in a real browser: `python -m tests.playground_speed`.

Prints and asserts nothing: first paint, bytes of the first view, the time from a change in a field
to the new plan on the screen, how far things jumped meanwhile, and how many steps of the live loop
were late, alone and with that going on beside it.
"""

import re
import statistics
import time

from playwright.sync_api import Browser, Page, expect

from app.settings import Settings
from tests.browser import Visit, chromium
from tests.served import serving, wait_until_ready

REPEATS = 20
LOOP_SECONDS = 20.0
PLANS = {
    "cem, K = 128": "method=cem&k=128",
    "dataset_prior, refined, K = 16": "method=dataset_prior&refine=yes",
    "action_diffusion, K = 16": "",
}
REPLAN = """(position) => new Promise((done) => {
    const field = document.getElementById("field-Target.0");
    const begun = performance.now();
    new PerformanceObserver((list, observer) => {
        observer.disconnect();
        requestAnimationFrame(() => setTimeout(() => done(performance.now() - begun)));
    }).observe({ type: "measure" });
    field.value = position;
    field.dispatchEvent(new Event("change", { bubbles: true }));
})"""
"""Change the target as a user does; the promise is kept after the frame with the new plan."""
PAINT = """() => performance.getEntriesByName("first-contentful-paint")[0].startTime"""
BYTES = """() => performance.getEntriesByType("navigation")
    .concat(performance.getEntriesByType("resource"))
    .reduce((sum, entry) => sum + entry.transferSize, 0)"""
SHIFT = """() => new Promise((done) => {
    const sum = (entries) => entries.reduce((total, one) => total + one.value, 0);
    new PerformanceObserver((list) => done(sum(list.getEntries())))
        .observe({ type: "layout-shift", buffered: true });
    setTimeout(() => done(0), 200);
})"""


def replan_ms(page: Page) -> list[float]:
    positions = (0.3 + 0.01 * index for index in range(REPEATS))
    return [float(page.evaluate(REPLAN, f"{position:g}")) for position in positions]


def print_plans(browser: Browser, url: str, beside: str) -> None:
    for name, address in PLANS.items():
        visit = Visit(browser, url, address)
        visit.says("Planned")
        took = replan_ms(visit.page)
        median, worst = statistics.median(took), max(took)
        print(f"{name}, {beside}: {median:.0f} ms to the new plan, at most {worst:.0f}")
        visit.page.close()


def steps_of(loop: Visit) -> tuple[int, int]:
    """Return how many steps a live loop has done, and how many were late."""
    steps, late = re.findall(r"\d+", loop.page.locator(".counts").inner_text())
    return int(steps), int(late)


def print_loop(loop: Visit, before: tuple[int, int], beside: str) -> None:
    steps, late = (now - then for now, then in zip(steps_of(loop), before, strict=True))
    trips = loop.page.locator(".results tbody td:last-child").all_inner_texts()
    print(f"live loop, {beside}: {steps} steps, {late} late; the last took {', '.join(trips)}")


def main() -> None:
    """Measure and print."""
    with serving(Settings()) as client, chromium() as browser:
        wait_until_ready(client)
        url = str(client.base_url).rstrip("/")
        for attempt in ("first visit", "second visit"):
            visit = Visit(browser, url)
            visit.says("Planned")
            print(f"{attempt}: painted after {visit.page.evaluate(PAINT):.0f} ms, ", end="")
            print(f"{visit.page.evaluate(BYTES) / 1e3:.0f} kB with the first plan")
        print(f"layout shift: {visit.page.evaluate(SHIFT):.3f}")
        print_plans(browser, url, "alone")
        loop = Visit(browser, url, "tab=loop")
        expect(loop.page.locator(".results")).to_contain_text("arrived")
        begun = steps_of(loop)
        time.sleep(LOOP_SECONDS)
        print_loop(loop, begun, "alone")
        print(f"layout shift of the loop: {loop.page.evaluate(SHIFT):.3f}")
        begun = steps_of(loop)
        print_plans(browser, url, "beside the live loop")
        print_loop(loop, begun, "beside those plans")


if __name__ == "__main__":
    main()

"""How quick the playground is in a real browser: `python -m tests.playground_speed`.

Prints and asserts nothing: first paint, bytes of the first view, the time from a change in a field
to the new plan on the screen, and how far things jumped meanwhile.
"""

import statistics

from playwright.sync_api import Page

from app.settings import Settings
from tests.browser import Visit, chromium
from tests.served import serving, wait_until_ready

REPEATS = 20
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
        for name, address in PLANS.items():
            visit = Visit(browser, url, address)
            visit.says("Planned")
            took = replan_ms(visit.page)
            worst = max(took)
            print(f"{name}: {statistics.median(took):.0f} ms to the new plan, at most {worst:.0f}")


if __name__ == "__main__":
    main()

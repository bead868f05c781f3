// The page without a pointer: Tab, and what the element that has the focus does with a key.

/** No page here has more stops. */
const STOPS = 40;

/** What has the focus: its id or name, what a screen reader calls it, and whether the eye finds it. */
const focused = (page) => page.evaluate(() => {
  const element = document.activeElement;
  if (element === document.body) return null;
  const text = (node) => node.textContent.trim().replace(/\s+/g, " ");
  const labels = [...(element.labels ?? [])].map(text).join(" ");
  const outlined = (node) => {
    const { outlineStyle, outlineWidth } = getComputedStyle(node);
    return outlineStyle !== "none" && parseFloat(outlineWidth) >= 2;
  };
  const box = (element.closest(".button") ?? element).getBoundingClientRect();
  return {
    id: element.id || element.name || element.localName,
    name: element.getAttribute("aria-label") || labels || text(element),
    outlined: outlined(element.closest(".button") ?? element),
    inside: box.width > 8 && box.height > 8 && box.bottom > 0 && box.top < innerHeight,
  };
});

/** Every stop of Tab, from the top of the page to its end. */
export async function walk(page) {
  const stops = [];
  for (let k = 0; k < STOPS; k++) {
    await page.keyboard.press("Tab");
    const stop = await focused(page);
    if (!stop) return stops;
    stops.push(stop);
  }
  throw new Error(`Tab does not leave the page after ${STOPS} stops`);
}

/** Tab until the focus is on it. */
export async function reach(page, id) {
  for (let k = 0; k <= STOPS; k++) {
    if ((await focused(page))?.id === id) return;
    await page.keyboard.press("Tab");
  }
  throw new Error(`Tab does not reach ${id}`);
}

/** Reach something and press keys there. */
export async function press(page, id, ...keys) {
  await reach(page, id);
  for (const key of keys) await page.keyboard.press(key);
}

/** Open the dialogue of a file field by its key, and choose there. */
export async function choose(page, id, files) {
  const dialogue = page.waitForEvent("filechooser");
  await press(page, id, "Enter");
  await (await dialogue).setFiles(files);
}

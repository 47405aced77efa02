// Opens pages as readers do, wide and narrow, light and dark and on paper, and says as JSON what they would see:
//
//   node visible.mjs CHROMIUM PAGE...
//
// { PAGE: { MODE: { errors, overflow, hidden, covered, faint, overlapping, uneven, pictures: { NAME: colours } } } }

import { launched, opened, settled } from "./browser.mjs";

const [WIDE, PHONE, PAPER] = [[1440, 900], [390, 844], [794, 1123]].map(([width, height]) => ({ width, height }));
const MODES = {
  "wide": [WIDE, { colorScheme: "light" }],
  "wide, dark": [WIDE, { colorScheme: "dark" }],
  "phone": [PHONE, { colorScheme: "light" }],
  "phone, dark": [PHONE, { colorScheme: "dark" }],
  // In the dark, too, paper is white.
  "paper": [PAPER, { colorScheme: "dark", media: "print" }],
};

/** What the page shows, measured inside it. On a screen each text is scrolled to in its turn. */
function measured(print) {
  const found = { hidden: [], covered: [], faint: [], overlapping: [], uneven: [] };
  const seen = (element) => element.checkVisibility({ visibilityProperty: true, opacityProperty: true });
  const pixel = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  const lineage = (element) => (element ? [...lineage(element.parentElement), element] : []);

  const paint = (color, opacity) => {
    pixel.globalAlpha = opacity;
    pixel.fillStyle = color;
    pixel.fillRect(0, 0, 1, 1);
    const [red, green, blue] = [...pixel.getImageData(0, 0, 1, 1).data].map((value) => {
      const part = value / 255;
      return part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
  };

  /** Of a text with all that lies below it, as WCAG 2.1 defines it. */
  const contrast = (element, x, y) => {
    const opacity = (one) => lineage(one).reduce((product, own) => product * getComputedStyle(own).opacity, 1);
    let ground = paint("white", 1);
    for (const one of document.elementsFromPoint(x, y).reverse()) ground = paint(getComputedStyle(one).backgroundColor, opacity(one));
    const style = getComputedStyle(element);
    const ink = paint(element instanceof SVGElement ? style.fill : style.color, opacity(element));
    return (Math.max(ink, ground) + 0.05) / (Math.min(ink, ground) + 0.05);
  };

  /** A box for each line of a text, or the one of a picture, without what its ancestors that scroll or clip cut off. */
  const boxesOf = ({ element, node }) => {
    const range = document.createRange();
    range.selectNode(node);
    const frames = lineage(element).filter((one) => one !== document.body && getComputedStyle(one).overflow !== "visible");
    return [...range.getClientRects()].map((box) => {
      const sides = [box, ...frames.map((one) => one.getBoundingClientRect())];
      const [left, top] = ["left", "top"].map((side) => Math.max(...sides.map((one) => one[side])));
      const [right, bottom] = ["right", "bottom"].map((side) => Math.min(...sides.map((one) => one[side])));
      return { left, top, right, bottom, lost: Math.max(box.width - (right - left), box.height - (bottom - top)) };
    });
  };

  const texts = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const { currentNode: node } = walker;
    const element = node.parentElement;
    if (!node.data.trim() || element.closest("script, style, noscript, option, title, dialog") || !seen(element)) continue;
    texts.push({ name: node.data.trim().slice(0, 60), element, node });
  }
  for (const text of texts) {
    const { name, element } = text;
    if (!print) element.scrollIntoView({ block: "center", inline: "center" });
    const shortened = lineage(element).some((one) => getComputedStyle(one).textOverflow === "ellipsis");
    for (const { left, top, right, bottom, lost } of boxesOf(text)) {
      if ((lost > 2 && !shortened) || left < -1 || right > innerWidth + 1) found.hidden.push(name);
      const [middle, y] = [(left + right) / 2, (top + bottom) / 2];
      const over = [left + 3, middle, right - 3].map((x) => document.elementFromPoint(x, y));
      const other = over.find((one) => one && !one.contains(element) && !element.contains(one));
      if (other) found.covered.push(`${name} | ${other.tagName} ${other.textContent.trim().slice(0, 30)}`);
      const ratio = contrast(element, middle, y);
      if (ratio < 4.5 && !element.closest(":disabled, [aria-disabled=true]")) found.faint.push(`${name}: ${ratio.toFixed(1)}`);
    }
  }

  for (const one of document.querySelectorAll("*")) one.scrollTo(0, 0);
  const images = [...document.images].filter(seen).map((image) => ({ name: image.alt, element: image, node: image }));
  const boxes = [...texts, ...images].flatMap((one) => boxesOf(one).map((box) => ({ ...box, ...one })));
  boxes.forEach((one, index) => {
    for (const other of boxes.slice(index + 1)) {
      // An upright name that was shortened has two boxes.
      if (one.node === other.node) continue;
      const across = Math.min(one.right, other.right) - Math.max(one.left, other.left);
      const down = Math.min(one.bottom, other.bottom) - Math.max(one.top, other.top);
      if (across > 2 && down > 4) found.overlapping.push(`${one.name} | ${other.name}`);
    }
  });

  const rows = [...document.querySelectorAll("tbody tr, #changes > li, .timeline li")].filter(seen);
  const tops = rows.map((row) => row.getBoundingClientRect());
  rows.forEach((row, index) => {
    if (index && row.parentElement === rows[index - 1].parentElement && tops[index].top < tops[index - 1].bottom - 1)
      found.overlapping.push(`row ${index - 1} | row ${index}`);
    if (getComputedStyle(row).display !== "table-row") return;
    for (const cell of row.cells) {
      const { top, bottom } = cell.getBoundingClientRect();
      if (Math.abs(top - tops[index].top) + Math.abs(bottom - tops[index].bottom) > 2)
        found.uneven.push(`${cell.textContent} in ${row.textContent.slice(0, 40)}`);
    }
  });
  return found;
}

/** How many colours each picture has in a screenshot of the whole page; 0 where it is not seen. */
async function colours(page) {
  await page.evaluate(async () => {
    for (const image of document.images) {
      if (!image.checkVisibility()) continue;
      image.scrollIntoView();
      await image.decode().catch(() => {});
    }
    scrollTo(0, 0);
  });
  const png = (await page.screenshot({ fullPage: true })).toString("base64");
  return page.evaluate(async (content) => {
    const bytes = Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));
    const shot = await createImageBitmap(new Blob([bytes]));
    const context = new OffscreenCanvas(shot.width, shot.height).getContext("2d", { willReadFrequently: true });
    context.drawImage(shot, 0, 0);
    const counted = {};
    const pictures = [...document.querySelectorAll("img, canvas, svg")];
    pictures.forEach((picture, index) => {
      const { x, y, width, height } = picture.getBoundingClientRect();
      const name = `${picture.tagName} ${picture.alt ?? picture.ariaLabel} ${index}`;
      const loaded = picture.tagName !== "IMG" || picture.naturalWidth > 0;
      if (!loaded || !picture.checkVisibility() || width < 2 || height < 2) return (counted[name] = 0);
      // Without its edge, which a frame would colour.
      const [left, top] = [Math.round(x + scrollX + width / 8), Math.round(y + scrollY + height / 8)];
      const { data } = context.getImageData(left, top, Math.max(1, 0.75 * width), Math.max(1, 0.75 * height));
      counted[name] = new Set(new Uint32Array(data.buffer)).size;
    });
    return counted;
  }, png);
}

const [chromium, ...files] = process.argv.slice(2);
const browser = await launched(chromium);
try {
  const seen = {};
  for (const file of files) {
    seen[file] = {};
    const { page, errors } = await opened(browser, file, WIDE);
    await page.addStyleTag({ content: "* { pointer-events: auto !important }" });
    for (const [mode, [size, media]] of Object.entries(MODES)) {
      await page.setViewportSize(size);
      await page.emulateMedia(media);
      if (media.media) {
        const height = await page.evaluate(() => document.documentElement.scrollHeight);
        await page.setViewportSize({ ...size, height });
      }
      await settled(page);
      const overflow = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      const found = await page.evaluate(measured, media.media === "print");
      seen[file][mode] = { overflow, ...found, pictures: await colours(page), errors: [...errors] };
    }
    await page.close();
  }
  console.log(JSON.stringify(seen));
} finally {
  await browser.close();
}

// Finds what a reader of the page would stumble over. `view` names the look of the page.
const measured = (view) => {
  const faults = [];
  let texts = 0;
  const fault = (what, text) => faults.push(`${view}: ${what}: ${JSON.stringify(text.trim().slice(0, 60))}`);
  const page = document.documentElement;
  if (page.scrollWidth > innerWidth) fault(`the page is ${page.scrollWidth} px wide`, document.title);

  // Colours as red, green, blue and alpha.
  const colour = (text) => {
    const [r, g, b, a = 1] = (text.match(/[\d.]+/g) || [0, 0, 0, 0]).map(Number);
    return text === 'none' || text === 'transparent' ? [0, 0, 0, 0] : [r, g, b, a];
  };
  const over = ([r, g, b, a], [x, y, z]) => [a * r + (1 - a) * x, a * g + (1 - a) * y, a * b + (1 - a) * z, 1];
  // Relative luminance and contrast as the Web Content Accessibility Guidelines 2.2 define them.
  const luminance = ([r, g, b]) => {
    const linear = (v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);
    return 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  };
  const contrast = (a, b) => {
    const [low, high] = [luminance(a), luminance(b)].sort((p, q) => p - q);
    return (high + 0.05) / (low + 0.05);
  };
  // What is behind an element of the page: the backgrounds of all that it stands in, the outermost first.
  const behind = (element) => {
    const layers = [];
    for (let at = element; at; at = at.parentElement) layers.push(colour(getComputedStyle(at).backgroundColor));
    return layers.reduceRight((below, layer) => over(layer, below), [255, 255, 255, 1]);
  };
  const readable = (ink, ground, text) => {
    const ratio = contrast(over(ink, ground), ground);
    if (ratio < 4.5) fault(`contrast ${ratio.toFixed(2)}`, text);
  };
  const within = (own, box, air) =>
    own.left >= box.left - air && own.right <= box.right + air && own.top >= box.top - air && own.bottom <= box.bottom + air;

  // Text of the page stays within every box that it stands in, out to the one in which it may be scrolled.
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode;
    const parent = node.parentElement;
    const style = getComputedStyle(parent);
    if (!node.data.trim() || parent.closest('svg, script, style') || style.visibility === 'hidden') continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    const own = [...range.getClientRects()].filter((r) => r.width > 0 && r.height > 0);
    if (!own.length) continue;
    texts += 1;
    readable(colour(style.color), behind(parent), node.data);
    for (let box = parent; box && box !== document.body; box = box.parentElement) {
      const { display, overflowX } = getComputedStyle(box);
      if (overflowX === 'auto' || overflowX === 'scroll') break;
      if (display.startsWith('inline') || display === 'contents' || display.startsWith('table-row')) continue;
      const edge = box.getBoundingClientRect();
      if (own.some((r) => r.left < edge.left - 1 || r.right > edge.right + 1)) {
        fault(`text leaves its ${box.tagName.toLowerCase()}`, node.data);
        break;
      }
    }
  }

  // Text of drawings stays within them, and none covers another.
  for (const drawing of document.querySelectorAll('svg')) {
    const frame = drawing.getBoundingClientRect();
    if (!frame.width) continue;
    const drawn = [...drawing.querySelectorAll('text')].filter((text) => text.textContent.trim());
    const boxes = drawn.map((text) => {
      const { left, right, top, bottom } = text.getBoundingClientRect();
      // Lines of type are higher than letters.
      const spare = 0.2 * (bottom - top);
      return { left, right, top: top + spare, bottom: bottom - spare };
    });
    const grounds = [...drawing.querySelectorAll('rect')];
    drawn.forEach((text, k) => {
      texts += 1;
      const own = boxes[k];
      if (!within(own, frame, 1)) fault('text leaves its drawing', text.textContent);
      let ground = behind(drawing.parentElement);
      const middle = [0.5 * (own.left + own.right), 0.5 * (own.top + own.bottom)];
      for (const rect of grounds) {
        const box = rect.getBoundingClientRect();
        const holds = middle[0] >= box.left && middle[0] <= box.right && middle[1] >= box.top && middle[1] <= box.bottom;
        const isBefore = rect.compareDocumentPosition(text) & Node.DOCUMENT_POSITION_FOLLOWING;
        if (!holds || !isBefore) continue;
        ground = over(colour(getComputedStyle(rect).fill), ground);
        if (own.right > box.right + 1) fault('text leaves its box', text.textContent);
      }
      readable(colour(getComputedStyle(text).fill), ground, text.textContent);
      for (let other = 0; other < k; other += 1) {
        const box = boxes[other];
        const across = Math.min(own.right, box.right) - Math.max(own.left, box.left);
        const down = Math.min(own.bottom, box.bottom) - Math.max(own.top, box.top);
        if (across > 0.5 && down > 0.5) fault(`text covers ${JSON.stringify(drawn[other].textContent)}`, text.textContent);
      }
    });
  }
  return { view, texts, faults };
};

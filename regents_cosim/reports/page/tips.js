// --- Words that say what they mean when they are pointed at, touched, or reached with the keyboard ---

const tip = element("div", { id: "tip", role: "tooltip", hidden: true });
document.body.append(tip);
let pointed = null; // the word whose meaning is shown

// A word with what it means, or the word alone where it speaks for itself.
function termed(words) {
  const meaning = page.terms[words.toLowerCase()];
  return meaning ? element("span", { className: "term", tabIndex: 0, dataset: { tip: meaning } }, words) : words;
}

function pointAt(word) {
  pointed?.removeAttribute("aria-describedby");
  pointed = word ?? null;
  tip.hidden = !pointed;
  if (!pointed) return;
  pointed.setAttribute("aria-describedby", "tip");
  tip.textContent = pointed.dataset.tip;
  placeTip();
}

// Below the word, or above it where there is no room; never beyond the window.
function placeTip() {
  if (!pointed) return;
  const [at, size] = [pointed.getBoundingClientRect(), tip.getBoundingClientRect()];
  const left = Math.max(8, Math.min(at.left, document.documentElement.clientWidth - size.width - 8));
  const below = at.bottom + 6 + size.height <= innerHeight;
  tip.style.setProperty("left", `${left}px`);
  tip.style.setProperty("top", `${below ? at.bottom + 6 : Math.max(8, at.top - 6 - size.height)}px`);
}

for (const event of ["mouseover", "focusin", "click"]) {
  document.addEventListener(event, ({ target }) => pointAt(target.closest?.("[data-tip]")));
}
document.addEventListener("focusout", () => pointAt(null));
addEventListener("scroll", placeTip, { passive: true });

// What a page must not look like: evaluates to functions that return what is wrong, as pieces of HTML.
({
// Things of a page that lie over each other.
overlaps: () => {
    const names = [
        "#title", "#subtitle", ".tools button", "#verdict > strong", "#verdict > span", ".violations", ".notice", ".zoom button",
        "h2", "#plan", ".layers label", ".legend li", ".robot .who", ".robot .charge", ".robot .why", ".robot .amount",
        ".robot .gauge", "#table-scroll", ".figure", "#lanes canvas", "#margins canvas", "figcaption", "#about dt", "#about dd",
    ];
    const pairs = (all) => all.flatMap((one, at) => all.slice(at + 1).map((other) => [one, other]));
    const seen = (selector) => [...document.querySelectorAll(selector)].filter((each) => !each.closest("[hidden], dialog, .scroll, .robots, #notices") || each.matches("#table-scroll"));
    const robots = [...document.querySelectorAll(".robot")].flatMap((card) => pairs([...card.querySelectorAll(".who, .charge, .why, .amount, .gauge")]));
    const player = [...document.querySelectorAll("#transport > :not([hidden])")];
    const beside = [...pairs(names.flatMap(seen)), ...robots, ...pairs(player)];
    return beside.filter(([one, other]) => {
        if (one.contains(other) || other.contains(one)) return false;
        const [a, b] = [one, other].map((each) => each.getBoundingClientRect());
        if (!a.width || !b.width) return false;
        return Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1 && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1;
    }).map((pair) => pair.map((each) => each.outerHTML.slice(0, 70)));
},

// Texts with less contrast than 4.5 to what is behind them (WCAG 2.1, AA).
pale: () => {
    // Mixed colours are told from 0 to 1.
    const channels = (text) => text.match(/[0-9.]+/g).map((each, at) => Number(each) * (text.startsWith("color(") && at < 3 ? 255 : 1));
    const luminance = (colour) => {
        const [red, green, blue] = channels(colour).map((each) => (each / 255 <= 0.04045 ? each / 255 / 12.92 : ((each / 255 + 0.055) / 1.055) ** 2.4));
        return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
    };
    const ground = (each) => {
        const colour = getComputedStyle(each).backgroundColor;
        return channels(colour)[3] === 0 && each.parentElement ? ground(each.parentElement) : colour;
    };
    return [...document.querySelectorAll("h1, h2, #subtitle, #verdict > *, .legend li, .why, .amount, .figure p, .clock b, figcaption")]
        .filter((each) => each.textContent.trim() && each.getBoundingClientRect().width)
        .filter((each) => {
            const [a, b] = [luminance(getComputedStyle(each).color), luminance(ground(each))];
            return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05) < 4.5;
        })
        .map((each) => each.outerHTML.slice(0, 80));
},
})

// The thesis, row by row: a search and two filters above the tables. Without this script the tables are all there.
"use strict";
(() => {
  const page = document.querySelector(".rows");
  if (!page) return;
  const tables = [...page.querySelectorAll("table")].filter(table => table.tHead?.textContent.includes("verdict"));
  const heading = table => {
    let before = table.closest(".md-typeset__scrollwrap, .md-typeset__table") ?? table;
    while (before.parentElement !== page) before = before.parentElement;
    const skipped = [before];
    while (before && before.tagName !== "H2") skipped.push(before = before.previousElementSibling);
    return { title: before.firstChild.textContent, all: skipped };
  };
  // "Eq. 4.26-4.29" holds 4.27 and 4.28, too
  const between = text => [...text.matchAll(/(\d+(?:\.\d+)*?\.)?(\d+)[-–](?:\1)?(\d+)/g)].flatMap(([, head = "", from, to]) =>
    to - from < 100 ? Array.from({ length: Math.max(0, to - from + 1) }, (_, k) => head + (+from + k)) : []).join(" ");
  const chapters = tables.map(table => {
    const verdict = [...table.tHead.rows[0].cells].findIndex(cell => cell.textContent.trim() === "verdict");
    const rows = [...table.tBodies[0].rows].map(row =>
      ({ row, text: `${row.textContent} ${between(row.cells[0].textContent)}`.toLowerCase(), verdict: row.cells[verdict].textContent.trim() }));
    return { ...heading(table), rows };
  });
  if (!chapters.length) return;

  const bar = document.createElement("form");
  bar.className = "rows-filter";
  bar.innerHTML = `<input type="search" placeholder="Search the rows" aria-label="Search the rows">
    <select aria-label="Verdict"><option value="">every verdict</option></select>
    <select aria-label="Chapter"><option value="">every chapter</option></select>
    <output aria-live="polite"></output>`;
  const [word, verdict, chapter] = bar.elements, count = bar.querySelector("output");
  const offer = (select, values) => values.forEach(value => select.add(new Option(value, value)));
  offer(verdict, [...new Set(chapters.flatMap(each => each.rows.map(row => row.verdict)))]);
  offer(chapter, chapters.map(each => each.title));

  const show = () => {
    const words = word.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0, total = 0;
    for (const each of chapters) {
      let some = false;
      for (const { row, text, verdict: its } of each.rows) {
        const fits = (!chapter.value || chapter.value === each.title) && (!verdict.value || verdict.value === its)
          && words.every(w => text.includes(w));
        row.hidden = !fits;
        some ||= fits;
        shown += fits;
        total++;
      }
      for (const part of each.all) part.hidden = !some;
    }
    count.textContent = shown ? `${shown} of ${total} rows` : `none of ${total} rows; a shorter word may find some`;
  };
  bar.addEventListener("input", show);
  bar.addEventListener("submit", event => event.preventDefault());
  chapters[0].all.at(-1).before(bar);
  show();
})();

// A long table of which only the rows near the view exist: ten thousand are shown as fast as ten.
//
// Rows are of one height. A space above and one below are as high as the rows that are not drawn, and
// assistive technology is told which row each one is, of how many.

const BEYOND = 15; // rows above and below the view, for the Tab key and a turn of the wheel

export class Rows {
  // `box` scrolls a table with the bodies .above, .shown and .below; `line` makes a row's <tr>.
  constructor(box, line) {
    this.box = box;
    this.line = line;
    this.table = box.querySelector("table");
    this.body = box.querySelector(".shown");
    this.spaces = [".above td", ".below td"].map((name) => box.querySelector(name));
    this.rows = [];
    this.lines = new Map(); // of the rows that are drawn: the row and its <tr>, by name
    this.height = 30; // of a row [px], until one is measured
    this.span = [0, 0];
    box.addEventListener("scroll", () => this.scrolled(), { passive: true });
    new ResizeObserver(() => this.draw()).observe(box);
  }

  // All rows, in order. What is drawn already and still in view stays as it is.
  show(rows) {
    this.rows = rows;
    this.table.setAttribute("aria-rowcount", rows.length + 1); // with the head
    this.draw();
  }

  toTop() {
    this.box.scrollTop = 0;
  }

  // Scroll as far as it takes to see the row at a place.
  reveal(at) {
    const top = at * this.height;
    const room = this.room();
    if (top < this.box.scrollTop) this.box.scrollTop = top;
    if (top + this.height > this.box.scrollTop + room) this.box.scrollTop = top + this.height - room;
    this.draw();
    this.lines.get(this.rows[at].name)?.made.scrollIntoView({ block: "nearest" });
  }

  // Height of the view below the head, which stays [px].
  room() {
    return Math.max(this.height, this.box.clientHeight - this.table.tHead.offsetHeight);
  }

  // The places of the first row in view, and of the one after the last.
  inView() {
    const end = Math.max(0, this.rows.length * this.height - this.room());
    const top = Math.min(this.box.scrollTop, end);
    const last = Math.ceil((top + this.room()) / this.height);
    return [Math.floor(top / this.height), Math.min(this.rows.length, last)];
  }

  scrolled() {
    const [first, last] = this.inView();
    if (first < this.span[0] || last > this.span[1]) this.draw();
  }

  draw() {
    this.place();
    const height = this.body.rows.length ? this.body.getBoundingClientRect().height / this.body.rows.length : 0;
    if (!height || Math.abs(height - this.height) < 0.01) return;
    this.height = height; // the first row that was ever drawn, or another type size
    this.place();
  }

  place() {
    const [first, last] = this.inView();
    this.span = [Math.max(0, first - BEYOND), Math.min(this.rows.length, last + BEYOND)];
    this.fill(this.rows.slice(...this.span).map((row, at) => this.lineOf(row, this.span[0] + at)));
    this.spaces[0].style.height = `${this.span[0] * this.height}px`;
    this.spaces[1].style.height = `${(this.rows.length - this.span[1]) * this.height}px`;
  }

  lineOf(row, at) {
    const known = this.lines.get(row.name);
    const isSame = known && (known.row === row || JSON.stringify(known.row) === JSON.stringify(row));
    const made = isSame ? known.made : this.line(row);
    made.setAttribute("aria-rowindex", at + 2); // the head is the first
    return { row, made };
  }

  // Put lines in place without touching those that stay: a box in one of them may have the focus.
  fill(lines) {
    const hadFocus = this.body.contains(document.activeElement);
    this.lines = new Map(lines.map((each) => [each.row.name, each]));
    const stay = new Set(lines.map((each) => each.made));
    for (const old of [...this.body.rows]) if (!stay.has(old)) old.remove();
    let next = this.body.firstElementChild;
    for (const { made } of lines) {
      if (made === next) next = next.nextElementSibling;
      else this.body.insertBefore(made, next);
    }
    if (hadFocus && !this.body.contains(document.activeElement)) this.box.focus({ preventScroll: true });
  }
}

/* Code in tables breaks between words alone. Wide tables and long code can be scrolled by keyboard; the copy buttons of
   code blocks are no landmarks. */
document$.subscribe(() => {
  for (const code of document.querySelectorAll("td code:not(:has(*))")) {
    const words = code.textContent.split(" ").map((textContent) => Object.assign(document.createElement("span"), { textContent }));
    code.replaceChildren(...words.flatMap((word, index) => (index ? [" ", word] : [word])));
  }
  for (const part of document.querySelectorAll(".md-typeset__scrollwrap")) part.tabIndex = 0;
  for (const part of document.querySelectorAll(".md-code__nav")) part.setAttribute("role", "presentation");
});

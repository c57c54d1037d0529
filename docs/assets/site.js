/* Wide tables and long code can be scrolled by keyboard; the copy buttons of code blocks are no landmarks. */
document$.subscribe(() => {
  for (const part of document.querySelectorAll(".md-typeset__scrollwrap")) part.tabIndex = 0;
  for (const part of document.querySelectorAll(".md-code__nav")) part.setAttribute("role", "presentation");
});

/* The theme lets wide tables and code scroll by themselves; whoever has no mouse must reach them. */
function reachable() {
  for (const part of document.querySelectorAll(".md-typeset__scrollwrap, .md-typeset pre > code")) {
    if (part.tabIndex >= 0) continue;
    part.tabIndex = 0;
    part.setAttribute("role", "group");
    part.setAttribute("aria-label", part.tagName === "CODE" ? "code" : "table");
  }
}
new MutationObserver(reachable).observe(document.body, { childList: true, subtree: true });
reachable();

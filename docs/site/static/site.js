// Accessibility of the theme's pages: blocks that scroll take the keyboard focus, captions of the
// navigation have a level, its two columns have names, and so have the links of the gallery.
// Pictures are links to themselves, because their labels are small on a phone.
document.addEventListener("DOMContentLoaded", () => {
  document.querySelectorAll("pre, .table-wrapper").forEach((block) => {
    block.tabIndex = 0;
  });
  document.querySelectorAll("p.caption[role=heading]").forEach((caption) => {
    caption.setAttribute("aria-level", "2");
  });
  document.querySelectorAll(".sphx-glr-thumbcontainer a").forEach((link) => {
    link.setAttribute("aria-label", link.textContent);
  });
  document.querySelectorAll("article p > img, img.sphx-glr-single-img").forEach((picture) => {
    const link = document.createElement("a");
    link.href = picture.src;
    link.title = "Open the picture alone";
    picture.replaceWith(link);
    link.append(picture);
  });
  // Names in code can break at their marks, but options can't break after their hyphens.
  const marks = /(?<=[A-Za-z][./])(?=\w)|(?<=\w{4}[_,=])(?=\w{4})/g;
  const option = '<span class="option">$&</span>';
  document.querySelectorAll("article code .pre").forEach((name) => {
    const text = name.innerHTML.replace(marks, "<wbr>");
    name.innerHTML = text.replace(/^--[\w-]+/, option);
  });
  // A command that is wider than the page goes on in an indented line.
  document.querySelectorAll(".highlight-sh pre").forEach((block) => {
    const lines = block.innerHTML.trimEnd().replace(/(?<=>)--[\w-]+/g, option).split("\n");
    block.innerHTML = lines.map((line) => `<span class="command">${line}</span>`).join("\n");
  });
  document.querySelector(".sidebar-drawer")?.setAttribute("aria-label", "All pages");
  document.querySelector(".toc-drawer")?.setAttribute("aria-label", "On this page");
});

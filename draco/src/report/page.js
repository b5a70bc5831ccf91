"use strict";
const map = document.querySelector("#map svg");
const boxes = [...document.querySelectorAll("[data-hide]")];
const slider = document.getElementById("until");
function redraw() {
  const until = Number(slider.value);
  slider.nextElementSibling.value = slider.value;
  for (const part of map.querySelectorAll("[data-k]")) part.classList.toggle("off", Number(part.dataset.k) > until);
  const hidden = boxes.filter((box) => !box.checked).map((box) => box.dataset.hide).join(",");
  for (const part of map.querySelectorAll(".points,.truth,.path,.closure")) {
    const wrong = part.classList.contains("wrong");
    const hide = hidden && part.matches(wrong ? hidden.replace(".accepted", ".none") || ".none" : hidden);
    part.style.display = hide ? "none" : "";
  }
}
slider.addEventListener("input", redraw);
for (const box of boxes) box.addEventListener("change", redraw);
document.body.dataset.ready = "yes";

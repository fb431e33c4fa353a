// A split picture: choose a view and two outputs, drag to move the border.
for (const box of document.querySelectorAll(".compare")) {
  const urls = JSON.parse(box.dataset.urls);
  const choice = (name) => box.querySelector(`select[name="${name}"]`).value;
  const show = () => {
    for (const side of ["left", "right"]) {
      const image = box.querySelector(`img.${side}`);
      const url = urls[choice("view")][choice(side)];
      if (url) image.src = url; else image.removeAttribute("src");
      image.alt = choice(side);
    }
  };
  const stage = box.querySelector(".stage");
  const range = box.querySelector("input");
  range.addEventListener("input", () => {
    stage.style.setProperty("--split", `${range.value}%`);
  });
  box.addEventListener("change", show);
  show();
}

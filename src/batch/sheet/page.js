const main = document.querySelector('main');
const cards = [...main.children];
const control = (id) => document.getElementById(id);

// A turntable: the mouse across the picture, or the slider. Links lead to the frame that is shown.
for (const card of cards) {
  const strip = card.querySelector('.strip');
  if (!strip || strip.dataset.count < 2) continue;
  const count = Number(strip.dataset.count);
  const image = strip.querySelector('img');
  const slider = card.querySelector('input[type=range]');
  const files = JSON.parse(strip.dataset.files);
  const links = card.querySelectorAll('a[data-ending]');
  const show = (frame) => {
    image.style.transform = `translateX(${-100 * frame / count}%)`;
    slider.value = frame;
    for (const link of links) link.href = files[frame] + link.dataset.ending;
  };
  slider.addEventListener('input', () => show(Number(slider.value)));
  strip.addEventListener('mousemove', (event) => {
    const box = strip.getBoundingClientRect();
    const part = (event.clientX - box.left) / box.width;
    show(Math.min(count - 1, Math.max(0, Math.floor(part * count))));
  });
}

const arrange = () => {
  const key = control('sort').value;
  const sign = control('down').checked ? -1 : 1;
  const value = (card) => card.dataset[key];
  const by = (a, b) => key === 'name'
    ? value(a).localeCompare(value(b), undefined, { numeric: true })
    : value(a) - value(b);
  const text = control('find').value.toLowerCase();
  cards.sort((a, b) => sign * by(a, b) || a.dataset.order - b.dataset.order);
  for (const card of cards) {
    card.hidden = !card.dataset.name.toLowerCase().includes(text)
      || control('bad').checked && card.dataset.state !== '0';
    main.append(card);
  }
};
for (const id of ['sort', 'down', 'bad', 'find']) control(id).addEventListener('input', arrange);

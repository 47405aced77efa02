import { Deck, OrbitView } from "@deck.gl/core";
import { PointCloudLayer } from "@deck.gl/layers";

export async function start(canvas, clouds) {
  const viewState = (angle) => ({ target: [0, 0, 0], rotationOrbit: (angle * 180) / Math.PI, rotationX: 30, zoom: 9.5 });
  let loaded;
  const ready = new Promise((resolve) => { loaded = resolve; });
  const deck = new Deck({
    canvas,
    width: canvas.width,
    height: canvas.height,
    useDevicePixels: false,
    deviceProps: { webgl: { antialias: false } },
    views: new OrbitView({ orbitAxis: "Z" }),
    viewState: viewState(0),
    onAfterRender: () => loaded(),
    layers: clouds.map(({ positions, colors }, index) => new PointCloudLayer({
      id: String(index),
      data: { length: positions.length / 3, attributes: {
        getPosition: { value: positions, size: 3 },
        getColor: { value: colors, size: 4, normalized: true },
      } },
      getNormal: [0, 0, 1],
      material: false,
      pointSize: 1,
    })),
  });
  await ready;
  return (angle) => {
    deck.setProps({ viewState: viewState(angle) });
    deck.redraw("benchmark");
  };
}

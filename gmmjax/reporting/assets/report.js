"use strict";

// Draws the three views and makes their cameras go together.
(() => {
  const { views, ranges, camera, dragmode } = JSON.parse(document.getElementById("scene").textContent);
  const axis = (range) => ({ visible: false, range, autorange: false, showspikes: false });
  const layout = () => ({
    autosize: true,
    margin: { l: 0, r: 0, t: 0, b: 0 },
    paper_bgcolor: "rgba(0,0,0,0)",
    showlegend: false,
    uirevision: "kept",
    scene: {
      xaxis: axis(ranges.x),
      yaxis: axis(ranges.y),
      zaxis: axis(ranges.z),
      aspectmode: "data",
      dragmode,
      camera: structuredClone(camera),
    },
  });
  const config = { displayModeBar: false, responsive: true, scrollZoom: true };
  const panes = Object.entries(views).map(([name, traces]) => {
    const pane = document.getElementById(`view-${name}`);
    return Plotly.newPlot(pane, traces, layout(), config).then(() => pane);
  });

  Promise.all(panes).then((drawn) => {
    let waiting = null;
    let following = false;

    const setCamera = (targets, wanted) => {
      following = true;
      return Promise.all(targets.map((pane) => Plotly.relayout(pane, { "scene.camera": structuredClone(wanted) })))
        .finally(() => { following = false; });
    };

    const follow = (leader) => (change) => {
      const wanted = change["scene.camera"];
      if (following || !wanted) return;
      // One update for each frame of the screen, with the latest camera.
      const frameIsDue = waiting !== null;
      waiting = { leader, wanted };
      if (frameIsDue) return;
      requestAnimationFrame(() => {
        const latest = waiting;
        waiting = null;
        setCamera(drawn.filter((pane) => pane !== latest.leader), latest.wanted);
      });
    };

    for (const pane of drawn) {
      pane.on("plotly_relayouting", follow(pane));
      pane.on("plotly_relayout", follow(pane));
    }
    document.getElementById("reset").addEventListener("click", () => setCamera(drawn, camera));
  });
})();

//! Mean alpha of shadow catchers, compared with numerical integrals.

use lightpath::LoadedScene;
use serde_json::{Value, json};

/// A ball that only shadows see.
const CENTER: [f64; 3] = [0.3, 0.2, 0.5];
const RADIUS: f64 = 0.3;

/// A catcher at z = 0, seen at the origin, under a square light that faces it.
struct Stage {
    /// Half of the light's side, and its height.
    light: [f64; 2],
    /// Lights in this place: how bright `id` and `is` are.
    colors: &'static [[f64; 2]],
    kd: f64,
    ks: f64,
    exponent: i32,
    /// Direction to the camera, of any length.
    view: [f64; 3],
}

const LAMP: Stage = Stage {
    light: [0.5, 3.0],
    colors: &[[1.0, 1.0]],
    kd: 1.0,
    ks: 0.0,
    exponent: 1,
    view: [0.2, 0.2, 1.0],
};

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    v.map(|x| x / dot(v, v).sqrt())
}

impl Stage {
    /// The share of the light that the ball takes, by the midpoint rule. Its error is at most a
    /// fiftieth of the tolerances here: 8e-4 under the ceiling, else 1.2e-4.
    fn integral(&self) -> f64 {
        const STEPS: u32 = 600;
        let ([half, height], view) = (self.light, unit(self.view));
        let [kd, ks] = [(0, self.kd), (1, self.ks)]
            .map(|(part, k)| k * self.colors.iter().map(|color| color[part]).sum::<f64>());
        let along = |k: u32| half * ((2 * k + 1) as f64 / f64::from(STEPS) - 1.0);
        let (mut taken, mut whole) = (0.0, 0.0);
        for (x, y) in (0..STEPS).flat_map(|x| (0..STEPS).map(move |y| (along(x), along(y)))) {
            let to_light = [x, y, height];
            let l = unit(to_light);
            let h = unit([l[0] + view[0], l[1] + view[1], l[2] + view[2]]);
            let light =
                (kd * l[2] + ks * h[2].powi(self.exponent)) / dot(to_light, to_light).sqrt();
            let (along, apart) = (dot(l, CENTER), dot(CENTER, CENTER));
            let hidden = along > 0.0 && apart - along * along < RADIUS * RADIUS;
            whole += light;
            taken += if hidden { light } else { 0.0 };
        }
        taken / whole
    }

    /// Mean alpha over many pixels, and the largest one.
    fn rendered(&self, points: u32, spp: u32) -> (f64, f64) {
        let [half, height] = self.light;
        let corner = |x: f64, y: f64| json!([x * half, y * half, height]);
        let position = self.view.map(|x| 4.0 * x);
        let light = |[id, is]: &[f64; 2]| {
            json!({ "type": "arealight", "v0": corner(-1.0, -1.0), "v1": corner(1.0, -1.0),
                "v2": corner(1.0, 1.0), "id": [id, id, id], "is": [is, is, is],
                "samples": points })
        };
        let scene: Value = json!({
            "spp": spp,
            "camera": { "type": "orthographic", "width": 32, "height": 32, "viewwidth": 1e-3,
                "position": position, "target": [0, 0, 0], "up": [0, 1, 0] },
            "scene": {
                "lightsources": self.colors.iter().map(light).collect::<Vec<_>>(),
                "shapes": [
                    { "type": "plane", "v0": [-9, -9, 0], "v1": [9, -9, 0], "v2": [9, 9, 0],
                      "v3": [-9, 9, 0], "shadow_catcher": true, "material": { "kd": self.kd,
                        "ks": self.ks, "specularexponent": self.exponent } },
                    { "type": "sphere", "center": CENTER, "radius": RADIUS, "material": {},
                      "visible": { "camera": false } }]
            }
        });
        let loaded = LoadedScene::from_json(&scene.to_string(), &[] as &[&str]).unwrap();
        let film = loaded.renderer().unwrap().render().unwrap();
        let alphas = || film.pixels.iter().map(|pixel| f64::from(pixel[3]));
        (alphas().sum::<f64>() / film.pixels.len() as f64, alphas().fold(0.0, f64::max))
    }
}

/// Terms of a large ceiling and of a gloss differ by much, so that few points know the expected
/// light badly, and the own points know it with the error of the light that shadows take.
#[test]
fn the_mean_alpha_is_the_share_of_light_that_shadows_take() {
    let lamp = Stage { view: [0.2, 0.0, 1.0], ..LAMP };
    let ceiling = Stage { light: [8.0, 1.5], ..lamp };
    let gloss = Stage { light: [2.0, 2.0], kd: 0.1, ks: 1.0, exponent: 100, ..LAMP };
    for (name, stage, tolerance) in
        [("lamp", lamp, 0.01), ("ceiling", ceiling, 0.04), ("gloss", gloss, 0.02)]
    {
        let expected = stage.integral();
        for (points, spp) in [(1, 64), (4, 16), (16, 4)] {
            let (mean, _) = stage.rendered(points, spp);
            let found = mean / expected - 1.0;
            assert!(found.abs() < tolerance, "{name} {points}: {mean} {expected} {found}");
        }
    }
}

#[test]
fn a_sharp_gloss_has_a_bounded_alpha() {
    let view = [-1.0, -0.5, 2.5];
    let stage = Stage { light: [2.0, 2.0], kd: 0.0, ks: 1.0, exponent: 1000, view, ..LAMP };
    // All of its light is in the shadow.
    for points in [1, 16] {
        let (mean, most) = stage.rendered(points, 16);
        assert!((mean - 1.0).abs() < 0.1, "{points}: {mean}");
        assert!(most < 100.0, "{points}: {most}");
    }
}

/// Lights in one place are one light of the sum of their colours.
#[test]
fn negative_light_counts_as_light_taken_away() {
    let lamp = Stage { colors: &[[2.0, 2.0], [-1.0, -1.0]], ..LAMP };
    let gloss = Stage { light: [2.0, 2.0], ks: 0.5, exponent: 20, ..LAMP };
    let matt = Stage { colors: &[[1.0, -1.0]], ..gloss };
    let both = Stage { colors: &[[2.0, 1.5], [-1.0, -2.0]], ..gloss };
    for (name, stage) in [("lamp", lamp), ("matt", matt), ("both", both)] {
        let expected = stage.integral();
        for (points, spp) in [(1, 16), (16, 4)] {
            let (mean, _) = stage.rendered(points, spp);
            let found = mean / expected - 1.0;
            assert!(found.abs() < 0.03, "{name} {points}: {mean} {expected} {found}");
        }
    }
}

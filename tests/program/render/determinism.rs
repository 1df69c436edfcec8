//! The same scene gives the same bytes for any number of threads, on every run, and for every crop.

use crate::support::backends::on_both;
use crate::support::program::Scratch;
use lightpath::scene::Backend;

/// A scene with everything that uses random numbers, bounces or packets: lens, both kinds of area
/// lights, point light, mirrors, mesh, sphere, plane.
const SCENE: &str = r#"{
  "nbounces": 4, "spp": 4, "seed": 5,
  "camera": { "type": "thinlens", "width": 101, "height": 67, "fov": 45, "aperture": 0.2,
              "focaldistance": 6, "position": [1, 3, 6], "lookat": [-0.1, -0.35, -1], "up": [0, 1, 0] },
  "scene": {
    "backgroundcolor": [0.1, 0.2, 0.3], "ambient": [0.1, 0.1, 0.1], "attenuation": "quadratic",
    "lightsources": [
      { "type": "pointlight", "position": [4, 6, 5], "id": [30, 20, 20] },
      { "type": "arealight", "v0": [-2, 5, 0], "v1": [0, 5, 0], "v2": [-2, 5, 2],
        "id": [20, 30, 20], "samples": 7 },
      { "type": "arealight", "v0": [2, 5, 2], "v1": [0, 5, 2], "v2": [2, 5, 4],
        "id": [30, 30, 60], "samples": 3, "emission": "lambertian" }],
    "shapes": [
      { "type": "trimesh", "path": "p.ply", "smooth": true,
        "material": { "ks": 0.5, "specularexponent": 30, "kr": 0.3 } },
      { "type": "sphere", "center": [2, 0.8, 0], "radius": 0.8, "material": { "kd": 0.2, "kr": 0.8 } },
      { "type": "sphere", "center": [-2, 0.7, 1], "radius": 0.7, "material": { "kr": 0.5, "ks": 1 } },
      { "type": "plane", "v0": [-9, 0, 9], "v1": [9, 0, 9], "v2": [9, 0, -9], "v3": [-9, 0, -9],
        "material": { "kd": 0.7, "ka": 1, "kr": 0.2 } }]
  }
}"#;

fn render(scratch: &Scratch, backend: Backend, prefix: &str, flags: &[&str]) {
    let fixed = ["render", "s.json", "-o", prefix, "--quiet", "--backend", backend.name()];
    scratch.run(&[&fixed[..], flags].concat()).good();
}

on_both! {
    fn the_same_bytes_for_any_threads_and_on_every_run(backend: Backend) {
        let scratch = Scratch::with(SCENE);
        for (spp, sampler) in [("1", "sobol"), ("4", "sobol"), ("21", "sobol"), ("5", "random")] {
            let flags = ["--spp", spp, "--sampler", sampler, "--threads"];
            render(&scratch, backend, "first", &[&flags[..], &["1"]].concat());
            for threads in ["1", "2", "5"] {
                render(&scratch, backend, "again", &[&flags[..], &[threads]].concat());
                for end in ["exr", "png"] {
                    let [first, again] =
                        ["first", "again"].map(|n| scratch.read(&format!("{n}.{end}")));
                    assert!(first == again, "{end} at {spp} spp with {threads} threads");
                }
            }
        }
    }
}

on_both! {
    fn another_seed_is_another_picture(backend: Backend) {
        let scratch = Scratch::with(SCENE);
        render(&scratch, backend, "a", &[]);
        render(&scratch, backend, "b", &["--seed", "6"]);
        assert_ne!(pixels(&scratch, "a"), pixels(&scratch, "b"));
        render(&scratch, backend, "b", &["--sampler", "random"]);
        assert_ne!(pixels(&scratch, "a"), pixels(&scratch, "b"));
    }
}

/// Returns rows of R, G, B, A as bits.
fn pixels(scratch: &Scratch, name: &str) -> Vec<Vec<[u32; 4]>> {
    let rows = scratch.rgba(&format!("{name}.exr")).into_iter();
    rows.map(|row| row.into_iter().map(|pixel| pixel.map(f32::to_bits)).collect()).collect()
}

on_both! {
    fn the_render_of_a_crop_is_the_crop_of_the_render(backend: Backend) {
        let scratch = Scratch::with(SCENE);
        let crops =
            [[0, 0, 1, 1], [3, 5, 40, 34], [31, 31, 33, 33], [50, 1, 101, 67], [97, 63, 101, 67]];
        for spp in ["1", "2", "4", "16"] {
            render(&scratch, backend, "full", &["--spp", spp]);
            let full = pixels(&scratch, "full");
            assert_eq!((full.len(), full[0].len()), (67, 101));
            for crop @ [x0, y0, x1, y1] in crops {
                let text = crop.map(|n: usize| n.to_string());
                let mut flags = vec!["--spp", spp, "--crop"];
                flags.extend(text.iter().map(String::as_str));
                render(&scratch, backend, "crop", &flags);
                let cut: Vec<_> = full[y0..y1].iter().map(|row| row[x0..x1].to_vec()).collect();
                assert!(pixels(&scratch, "crop") == cut, "{crop:?} at {spp} spp");
            }
        }
    }
}

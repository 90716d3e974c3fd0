//! The HTML page of a report.

use serde_json::Value;

use crate::html::{escape, head};

/// The page that shows `data` (what `data.json` holds).
pub(super) fn page(data: &Value) -> String {
    let mut html = head("Accuracy for time");
    html += &format!(
        "<p>relMSE against every light (<code>brute</code>) at the very same camera rays, {} per pixel, seed {}: what differs is light selection alone. Times are of rendering on {} threads of {}, without building the tree. \
         Made by <code>{}</code> at {}. Data: <a href=\"data.json\">JSON</a>, <a href=\"data.csv\">CSV</a>; every picture is there as EXR, too.</p>\n",
        data["spp"],
        data["seed"],
        data["threads"],
        text(&data["made_by"]["machine"]["processor"]),
        text(&data["made_by"]["command"]),
        text(&data["made_by"]["commit"]),
    );
    for scene in list(&data["scenes"]) {
        html += &section(scene);
    }
    html + "</body>\n</html>\n"
}

fn section(scene: &Value) -> String {
    let name = text(&scene["scene"]);
    let stem = text(&scene["stem"]);
    let mut html = format!(
        "<h2>{name}</h2>\n<p>{} lights, {}×{} pixels. The reference took {:.1} s; {}.</p>\n<img src=\"{stem}.svg\" alt=\"{name}: relMSE against seconds\">\n",
        scene["lights"],
        scene["width"],
        scene["height"],
        scene["reference"]["seconds"].as_f64().unwrap_or_default(),
        text(&scene["reference"]["description"]),
    );
    html += &times(scene);
    html += "<table>\n<tr><th>method</th><th>setting</th><th>build, s</th><th>render, s</th><th>shadow rays</th><th>relMSE</th><th>MAPE</th><th>FLIP</th></tr>\n";
    for curve in list(&scene["curves"]) {
        for point in list(&curve["points"]) {
            let error = &point["error"];
            let small = |key: &str| error[key].as_f64().map_or_else(|| "–".to_owned(), |v| format!("{v:.4}"));
            html += &format!(
                "<tr><td>{}</td><td>{} {}</td><td>{:.3}</td><td>{:.3}</td><td>{}</td><td>{:.2e}</td><td>{}</td><td>{}</td></tr>\n",
                text(&curve["method"]),
                text(&curve["key"]),
                text(&point["value"]),
                point["seconds"]["build_lights"].as_f64().unwrap_or_default(),
                point["seconds"]["render"].as_f64().unwrap_or_default(),
                point["counts"]["shadow_rays"],
                error["relmse"].as_f64().unwrap_or_default(),
                small("mape"),
                small("flip"),
            );
        }
    }
    html += "</table>\n<div class=\"pictures\">\n";
    let picture = |name: &str, caption: &str| {
        format!(
            "<figure><img src=\"{stem}-{name}.png\" alt=\"{caption}\"><figcaption><b>{name}</b> {caption}</figcaption></figure>\n"
        )
    };
    for curve in list(&scene["curves"]) {
        if let Some(point) = list(&curve["points"]).get(list(&curve["points"]).len() / 2) {
            let caption = format!("{} {}", text(&curve["key"]), text(&point["value"]));
            html += &picture(&text(&curve["method"]), &caption);
        }
    }
    html + &picture("reference", "every light") + "</div>\n"
}

/// What each method takes to three accuracies; the fastest stands out.
fn times(scene: &Value) -> String {
    let curves = list(&scene["curves"]);
    let targets = ["1e-2", "1e-3", "1e-4"];
    let seconds = |curve: &Value, target: &str| curve["seconds_to_relmse"][target].as_f64();
    let best = targets
        .map(|target| curves.iter().filter_map(|curve| seconds(curve, target)).fold(f64::INFINITY, f64::min));
    let mut html = String::from(
        "<table>\n<tr><th>seconds to a relMSE of</th><th>10<sup>−2</sup></th><th>10<sup>−3</sup></th><th>10<sup>−4</sup></th></tr>\n",
    );
    for curve in curves {
        html += &format!("<tr><td>{}</td>", text(&curve["method"]));
        for (target, best) in targets.iter().zip(best) {
            html += &seconds(curve, target).map_or_else(
                || "<td>–</td>".to_owned(),
                |s| format!("<td{}>{s:.3}</td>", if s <= best { " class=\"best\"" } else { "" }),
            );
        }
        html += "</tr>\n";
    }
    html + "</table>\n"
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map(Vec::as_slice).unwrap_or_default()
}

fn text(value: &Value) -> String {
    escape(value.as_str().unwrap_or_default())
}

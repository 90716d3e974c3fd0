//! The HTML page of a comparison: one file beside its pictures, no script, no network.

use serde_json::Value;

use crate::html::{self, escape};

/// The page that shows `data` (what `data.json` holds).
pub(super) fn page(data: &Value) -> String {
    let methods = data["methods"].as_array().map(Vec::as_slice).unwrap_or_default();
    let scene = escape(data["scene"].as_str().unwrap_or_default());
    let seconds = data["seconds_per_method"].as_f64().unwrap_or_default();
    let mut html = html::head(&format!("{scene}: methods compared"));
    html += &format!(
        "<p>{} lights, {}×{} pixels, seed {}, {seconds} seconds per method on {} threads of {}, light tree included. The reference: {}. Errors have no unit, but \
         MSE: (W/m²/sr)². Made by <code>{}</code> at {}. Data: <a href=\"data.json\">JSON</a>, <a href=\"data.csv\">CSV</a>; every picture is there as EXR, too.</p>\n",
        data["lights"],
        data["width"],
        data["height"],
        data["seed"],
        data["threads"],
        text(&data["made_by"]["machine"]["processor"]),
        text(&data["reference"]["description"]),
        text(&data["made_by"]["command"]),
        text(&data["made_by"]["commit"]),
    );
    html += &table(methods);
    html += "<div class=\"pictures\">\n";
    for method in methods {
        let name = escape(method["method"].as_str().unwrap_or_default());
        let what = escape(method["what"].as_str().unwrap_or_default());
        html += &format!(
            "<figure><img src=\"{name}.png\" alt=\"{scene} by {name}\"><figcaption><b>{name}</b>, {} spp. {what}</figcaption></figure>\n",
            method["spp"]
        );
    }
    html += &format!(
        "<figure><img src=\"reference.png\" alt=\"{scene}, the reference\"><figcaption><b>reference</b></figcaption></figure>\n</div>\n</body>\n</html>\n"
    );
    html
}

fn text(value: &Value) -> String {
    escape(value.as_str().unwrap_or("an unknown one"))
}

/// A row per method; the smallest relMSE stands out.
fn table(methods: &[Value]) -> String {
    let relmse = |method: &Value| method["error"]["relmse"].as_f64().unwrap_or(f64::INFINITY);
    let best = methods.iter().map(relmse).fold(f64::INFINITY, f64::min);
    let mut html = String::from(
        "<table>\n<tr><th>method</th><th>spp</th><th>build, s</th><th>render, s</th><th>shadow rays</th><th>relMSE</th><th>MSE</th><th>MAPE</th><th>SSIM</th><th>FLIP</th></tr>\n",
    );
    for method in methods {
        let class = if relmse(method) <= best { " class=\"best\"" } else { "" };
        let error = &method["error"];
        let small = |key: &str| error[key].as_f64().map_or_else(|| "–".to_owned(), |v| format!("{v:.4}"));
        let power = |key: &str| error[key].as_f64().map_or_else(|| "–".to_owned(), |v| format!("{v:.2e}"));
        html += &format!(
            "<tr><td>{}</td><td>{}</td><td>{:.2}</td><td>{:.2}</td><td>{}</td><td{class}>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
            escape(method["method"].as_str().unwrap_or_default()),
            method["spp"],
            method["seconds"]["build_lights"].as_f64().unwrap_or_default(),
            method["seconds"]["render"].as_f64().unwrap_or_default(),
            method["counts"]["shadow_rays"],
            power("relmse"),
            power("mse"),
            small("mape"),
            small("ssim"),
            small("flip"),
        );
    }
    html + "</table>\n"
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    #[test]
    fn a_scene_name_cannot_break_the_page() {
        let page = super::page(&json!({ "scene": "<script>\"&", "methods": [] }));
        assert!(!page.contains("<script>") && page.contains("&lt;script&gt;&quot;&amp;"));
    }
}

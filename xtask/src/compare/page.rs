//! The HTML page of a comparison: one file beside its pictures, no script, no network.

use serde_json::Value;

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:75rem;padding:0 1rem;background:#16181c;color:#e6e6e6}
h1{font-weight:600;font-size:1.4rem}p{max-width:50rem}a{color:#8ab4f8}
table{border-collapse:collapse;font-variant-numeric:tabular-nums;width:100%}
th,td{padding:.35rem .7rem;text-align:right;border-bottom:1px solid #33363d}th:first-child,td:first-child{text-align:left}
.best{color:#9be29b;font-weight:600}.pictures{display:grid;grid-template-columns:repeat(auto-fill,minmax(22rem,1fr));gap:1rem;margin-top:1.5rem}
figure{margin:0}img{width:100%;image-rendering:pixelated;display:block;background:#000}figcaption{font-size:.85rem;color:#aab}";

/// The page that shows `data` (what `data.json` holds).
pub(super) fn page(data: &Value) -> String {
    let methods = data["methods"].as_array().map(Vec::as_slice).unwrap_or_default();
    let scene = escape(data["scene"].as_str().unwrap_or_default());
    let seconds = data["seconds_per_method"].as_f64().unwrap_or_default();
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{scene}: methods compared</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{scene}: methods compared</h1>\n"
    );
    html += &format!(
        "<p>{}×{} pixels, {seconds} seconds per method on {} threads, light tree included. The reference: {}. Data: \
         <a href=\"data.json\">JSON</a>, <a href=\"data.csv\">CSV</a>; every picture is there as EXR, too.</p>\n",
        data["width"],
        data["height"],
        data["threads"],
        escape(data["reference"]["description"].as_str().unwrap_or_default())
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

/// Text that is safe inside an element or a quoted attribute: a scene's name comes from a file.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
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

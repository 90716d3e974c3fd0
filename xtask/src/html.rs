//! What the pages share that the program writes: one file each beside its pictures, no script, no network.

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:75rem;padding:0 1rem;background:#16181c;color:#e6e6e6}
h1{font-weight:600;font-size:1.4rem}p{max-width:50rem}a{color:#8ab4f8}
table{border-collapse:collapse;font-variant-numeric:tabular-nums;width:100%}
th,td{padding:.35rem .7rem;text-align:right;border-bottom:1px solid #33363d}th:first-child,td:first-child{text-align:left}
.best{color:#9be29b;font-weight:600}.pictures{display:grid;grid-template-columns:repeat(auto-fill,minmax(22rem,1fr));gap:1rem;margin-top:1.5rem}
figure{margin:0}img{width:100%;image-rendering:pixelated;display:block;background:#000}figcaption{font-size:.85rem;color:#aab}";

/// A page up to its heading; `title` is escaped already.
pub(crate) fn head(title: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n"
    )
}

/// Text that is safe inside an element or a quoted attribute: a scene's name comes from a file.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

"""Names that do harm where they are shown as they are: in terminals, spreadsheets, Markdown, HTML, SVG and XML."""

from __future__ import annotations

HOSTILE = (
    "\x1b[2J\x1b]0;owned\x07",
    "two\nlines\r\rthree",
    "\udcff\udc80",
    "\u202egnp.exe",
    "\x9b31m\x00\x7f",
    '=cmd|"/c calc"!A1',
    "+1+cmd|x",
    "@SUM(A1)",
    "-2+3",
    "\t=1+1",
    "<script>alert(1)</script>",
    "</script><img src=x onerror=alert(1)>",
    "a|b||c",
    "`code` ``two``",
    "`<img src=x onerror=alert(1)>`",
    "[link](javascript:alert(1))",
    "![](http://evil/x.png)",
    "&lt;b&gt; &#60;",
    "*bold* _it_ **b**",
    "$\\frac{1}{$",
    "]]> --> <!--",
    "\\| \\` \\<",
    "\ufffe\uffff",
)

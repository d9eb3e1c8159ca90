"""How results are rendered: blocks, which every presentation consists of, as text and as HTML; numbers and colours."""

"""Write the engine's kind module with quadruple instead of double precision."""

import sys
from pathlib import Path

source, target = (Path(name) for name in sys.argv[1:])
text = source.read_text()
if text.count("real64") != 2:
    sys.exit(f"{source}: expected the kind once imported and once assigned")
target.write_text(text.replace("real64", "real128"))

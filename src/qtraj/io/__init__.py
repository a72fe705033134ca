"""Layer 6: files for the exchange of data with other tools."""

import lazy_loader

__getattr__, _, _ = lazy_loader.attach(__name__, ["exchange"])

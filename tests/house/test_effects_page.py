"""The catalogue's pages say what there is: the grid, the cards, and what tells effects apart."""

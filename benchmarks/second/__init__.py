"""The second blind trial of the effect search: another simulator, another author, other forms.

Open ``README.md`` first. Nothing here knows how the search works: the people are written from the
formulas of the literature, and the search is used through its public interface only (``judge.py``).
"""

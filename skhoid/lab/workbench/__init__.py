"""The workbench: a server for one person at one machine, and the page that it shows.

``bench`` holds what is open and does what is asked; ``app`` are the addresses at which the page
asks, ``security`` says who may; ``columns`` and ``opening`` make data of files, ``jobs`` runs
searches, ``session`` keeps all in a folder, ``saving`` writes reports, ``serving`` starts it.
"""

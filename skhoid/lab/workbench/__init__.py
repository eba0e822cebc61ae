"""The workbench: a server for one person at one machine, and the page that it shows.

``bench`` holds what is open and does what is asked; ``server`` starts the server, says who may ask,
and answers; ``columns`` makes data of files, ``jobs`` runs searches in a process of their own,
``session`` keeps all in a folder.
"""

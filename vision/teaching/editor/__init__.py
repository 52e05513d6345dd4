"""The teaching page: what a person sees and touches. The only place that imports NiceGUI.

``server.serve`` opens it. The modules without a page in them: ``workshop`` holds the one session of a directory,
``findings`` says what follows from the marks, ``overlays`` what the extractors find, ``workers`` runs what is slow,
``child_process`` ends those when the page is killed.
"""

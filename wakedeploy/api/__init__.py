"""The functions behind `import wakedeploy as wd`: what a notebook calls, and the commands too.

In: paths and objects of the other packages. Out: objects that show themselves in a notebook. May
import everything but the command line; torch is loaded only by what trains. The public names are
listed in `wakedeploy/__init__.py`.
"""

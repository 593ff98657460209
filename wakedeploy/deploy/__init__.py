"""Packages on the machine at the rig: copied, checked there, made current, rolled back.

In: a package and the name of a host that ssh knows. Out: the package in use there. May import
`wakedeploy.core`.
"""

"""What logs of a user's system can tell, and which input would tell more, before it is recorded.

In: a system and logs from which its noise is known. Out: the smallest size of each effect that such
logs name (`power`), and the input that makes an effect seen or splits a class best (`plan`).
"""

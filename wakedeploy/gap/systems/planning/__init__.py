"""What logs of a user's system can show, and which input would show more, before it is recorded.

In: a system and logs from which its noise is known. Out: the smallest size of each effect that such
logs name (`power`), and the input that makes an effect seen or splits a class best (`plan`).
"""

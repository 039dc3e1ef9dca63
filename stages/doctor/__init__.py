"""Can pumps work here?"""

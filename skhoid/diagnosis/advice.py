def advise(c, signals, channels):
    return []

def html(c):
    return ""


def summary(c):
    return ""

"""Pages that a browser opens without a network: the flight page and the parts that the report of scenarios shares.

readings   series out of recordings and journals, thinned and packed for a page
flight     what the page of one flight shows, out of a replay, a journal, or a bag with one
document   one file of content, style, scripts and the plot library
"""

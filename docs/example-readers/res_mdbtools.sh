#!/bin/sh
# Prints the samples of an Arbin .res file as CSV, by mdb-export of mdbtools (GPL-2.0-or-later), a program of its own:
# Debian, Ubuntu: apt-get install mdbtools. In bench.toml:
#
#     [readers]
#     ".res" = ["/path/of/res_mdbtools.sh"]
exec mdb-export "$1" Channel_Normal_Table

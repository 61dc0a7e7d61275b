#!/usr/bin/env bash
# Six places that SUMO's own tools make, for docs/results.md: bash docs/made-places.sh FOLDER
#
# An old town (one narrow lane, priority to the right), lights at the junctions of a random town, a random town and a grid
# with left-hand traffic, a spider's web of priority roads, and a motorway with two on-ramps and an off-ramp; random trips.
set -euo pipefail
mkdir -p "$1"
cd "$1"
SUMO_HOME=$(python -c "import sumo; print(sumo.SUMO_HOME)")
export SUMO_HOME

town="--no-turnarounds.except-deadend true"
netgenerate $town --rand --rand.iterations 150 --seed 11 -L 1 -S 8.33 -j right_before_left \
    --rand.min-distance 40 --rand.max-distance 90 -o old_town.net.xml
netgenerate $town --rand --rand.iterations 100 --seed 12 -L 2 -S 13.89 --tls.guess true \
    --rand.min-distance 100 --rand.max-distance 250 -o lights.net.xml
netgenerate $town --rand --rand.iterations 100 --seed 13 --rand.random-lanenumber -L 2 -S 13.89 -j priority \
    --lefthand true -o left_hand.net.xml
netgenerate $town --grid --grid.number 4 --grid.length 150 -L 2 -S 13.89 -j traffic_light --lefthand true \
    -o left_hand_grid.net.xml
netgenerate $town --spider --spider.arm-number 7 --spider.circle-number 3 --spider.space-radius 90 -S 11.11 \
    -j priority -L 1 -o spider.net.xml

cat > motorway.nod.xml <<X
<nodes>
    <node id="a" x="0" y="0"/> <node id="b" x="600" y="0" type="priority"/> <node id="c" x="1200" y="0" type="priority"/>
    <node id="d" x="1800" y="0"/> <node id="e" x="2400" y="0" type="priority"/> <node id="f" x="3000" y="0"/>
    <node id="r1" x="300" y="-80"/> <node id="r2" x="1500" y="-80"/> <node id="r3" x="2100" y="-80"/>
</nodes>
X
cat > motorway.edg.xml <<X
<edges>
    <edge id="ab" from="a" to="b" numLanes="3" speed="36.11" priority="9"/>
    <edge id="bc" from="b" to="c" numLanes="3" speed="36.11" priority="9"/>
    <edge id="cd" from="c" to="d" numLanes="3" speed="36.11" priority="9"/>
    <edge id="de" from="d" to="e" numLanes="3" speed="36.11" priority="9"/>
    <edge id="ef" from="e" to="f" numLanes="3" speed="36.11" priority="9"/>
    <edge id="on1" from="r1" to="b" numLanes="1" speed="22.22" priority="3"/>
    <edge id="off1" from="c" to="r2" numLanes="1" speed="22.22" priority="3"/>
    <edge id="on2" from="r3" to="e" numLanes="1" speed="22.22" priority="3"/>
</edges>
X
netconvert -n motorway.nod.xml -e motorway.edg.xml --ramps.guess true --no-turnarounds true -o motorway.net.xml

drive() { # NAME, seconds between departures, how much oftener a trip begins and ends at the edge of the net
    python "$SUMO_HOME/tools/randomTrips.py" -n "$1.net.xml" -o "$1.trips.xml" -r "$1.rou.xml" -b 0 -e 900 \
        -p "$2" --fringe-factor "$3" --seed 21 --validate > /dev/null
    cat > "$1.sumocfg" <<X
<configuration>
    <input><net-file value="$1.net.xml"/><route-files value="$1.rou.xml"/></input>
    <time><begin value="0"/><end value="900"/></time>
</configuration>
X
}
drive old_town 1.5 3
drive lights 1.0 5
drive left_hand 1.0 5
drive left_hand_grid 0.8 5
drive spider 1.2 3
drive motorway 0.6 100

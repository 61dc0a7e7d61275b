#!/usr/bin/env bash
# Places that SUMO's own tools make to teach AIM-BEV on: bash docs/taught-places.sh FOLDER
# (FOLDER NUMBER adds the number to all seeds: other towns by the same rules, and other traffic on the same grids and webs)
#
# Random towns, grids and webs: one to three lanes, 30 to 80 km/h, priority, right before left, all-way stops and
# lights, with traffic on the right and on the left, thin and dense; cars, vans, lorries, buses, motorcycles and
# bicycles. None of them is a place of made-places.sh.
set -euo pipefail
mkdir -p "$1"
cd "$1"
SUMO_HOME=$(python -c "import sumo; print(sumo.SUMO_HOME)")
export SUMO_HOME

cat > mix.add.xml <<X
<additional>
    <vTypeDistribution id="mix">
        <vType id="car" vClass="passenger" probability="0.72"/>
        <vType id="brisk" vClass="passenger" probability="0.08" accel="3.5" speedFactor="normc(1.15,0.1,0.9,1.4)"/>
        <vType id="van" vClass="delivery" probability="0.06"/>
        <vType id="lorry" vClass="truck" probability="0.05"/>
        <vType id="bus" vClass="bus" probability="0.03"/>
        <vType id="motorcycle" vClass="motorcycle" probability="0.03"/>
        <vType id="bicycle" vClass="bicycle" probability="0.03"/>
    </vTypeDistribution>
</additional>
X

number=0
more=${2:-0}
# NAME, seconds between departures, how much oftener a trip begins and ends at the edge, options of netgenerate
place() {
    local name=$1 period=$2 fringe=$3
    shift 3
    number=$((number + 1))
    netgenerate --no-turnarounds.except-deadend true --seed $((400 + more + number)) "$@" -o "$name.net.xml" > /dev/null
    python "$SUMO_HOME/tools/randomTrips.py" -n "$name.net.xml" -a mix.add.xml -o "$name.trips.xml" -r "$name.rou.xml" \
        -b 0 -e 600 -p "$period" --fringe-factor "$fringe" --seed $((500 + more + number)) --validate \
        --trip-attributes 'type="mix" departLane="best" departSpeed="max"' > /dev/null
    cat > "$name.sumocfg" <<X
<configuration>
    <input><net-file value="$name.net.xml"/><route-files value="$name.rou.xml"/></input>
    <time><begin value="0"/><end value="600"/></time>
</configuration>
X
}

town() { # NAME, period, iterations, least and most length of a street [m], options
    local name=$1 period=$2 iterations=$3 least=$4 most=$5
    shift 5
    place "$name" "$period" 4 --rand --rand.iterations "$iterations" --rand.min-distance "$least" \
        --rand.max-distance "$most" "$@"
}

town village_a 2.0 120 50 120 -L 1 -S 8.33 -j right_before_left
town village_b 1.5 150 40 80 -L 1 -S 8.33 -j right_before_left --lefthand true
town village_c 1.2 150 60 150 -L 1 -S 13.89 -j right_before_left
town stops_a 1.0 120 60 140 -L 1 -S 11.11 -j allway_stop
town yields_a 1.0 120 80 200 -L 1 -S 13.89 -j priority
town yields_b 0.7 150 60 160 -L 2 -S 13.89 -j priority --rand.random-lanenumber
town yields_c 0.8 120 100 260 -L 3 -S 16.67 -j priority --rand.random-lanenumber
town yields_d 0.9 120 80 200 -L 2 -S 13.89 -j priority --rand.random-lanenumber --lefthand true
town yields_e 0.6 150 70 180 -L 2 -S 11.11 -j priority --rand.random-priority
town country 1.2 100 200 500 -L 1 -S 22.22 -j priority
town roads 0.8 100 200 450 -L 2 -S 22.22 -j priority --rand.random-lanenumber
town lights_a 0.8 120 100 220 -L 2 -S 13.89 --tls.guess true
town lights_b 0.6 120 80 200 -L 2 -S 13.89 -j traffic_light
town lights_c 0.5 120 120 260 -L 3 -S 13.89 -j traffic_light --rand.random-lanenumber
town lights_d 0.7 120 90 200 -L 1 -S 13.89 -j traffic_light
town lights_e 0.7 120 100 240 -L 2 -S 13.89 -j traffic_light --lefthand true
town lights_f 0.8 100 150 350 -L 2 -S 19.44 --tls.guess true --rand.random-lanenumber
town lights_g 0.6 120 80 180 -L 2 -S 13.89 -j traffic_light --tls.layout incoming
place blocks_a 0.9 6 --grid --grid.number 5 --grid.length 100 -L 1 -S 13.89 -j priority
place blocks_b 0.6 6 --grid --grid.number 4 --grid.length 180 -L 2 -S 13.89 -j traffic_light
place blocks_c 0.5 6 --grid --grid.x-number 3 --grid.y-number 5 --grid.x-length 240 --grid.y-length 130 -L 3 \
    -S 16.67 -j traffic_light --turn-lanes 1
place blocks_d 0.8 6 --grid --grid.number 6 --grid.length 70 -L 1 -S 8.33 -j right_before_left
place blocks_e 0.7 6 --grid --grid.number 4 --grid.length 120 -L 2 -S 13.89 -j priority --lefthand true
place blocks_f 0.5 6 --grid --grid.number 4 --grid.length 160 -L 2 -S 13.89 -j traffic_light_right_on_red
place blocks_g 0.5 6 --grid --grid.number 3 --grid.length 300 -L 2 -S 13.89 -j traffic_light --turn-lanes 1 \
    --turn-lanes.length 60
place blocks_h 0.9 6 --grid --grid.number 5 --grid.length 90 -L 1 -S 11.11 -j allway_stop
place web_a 1.0 4 --spider --spider.arm-number 5 --spider.circle-number 3 --spider.space-radius 100 -L 1 \
    -S 13.89 -j priority
place web_b 0.8 4 --spider --spider.arm-number 8 --spider.circle-number 2 --spider.space-radius 140 -L 2 \
    -S 13.89 -j traffic_light
place web_c 1.2 4 --spider --spider.arm-number 6 --spider.circle-number 3 --spider.space-radius 80 -L 1 \
    -S 8.33 -j right_before_left
place web_d 0.8 4 --spider --spider.arm-number 6 --spider.circle-number 2 --spider.space-radius 160 -L 2 \
    -S 16.67 -j priority --spider.omit-center true --lefthand true

"""Allow-list of SUMO's options, elements and attributes for runs that write nothing.

They are taken from the versions of SUMO that the tests use, without those that name a file or make SUMO write. Anything
else is removed (`config`, `files`), so that a newer SUMO cannot be made to write either. Everything that
affects the traffic must be listed, or the traffic would change.
"""

OF_NET, OF_ROUTES, OF_ADDITIONAL, OF_STATE = "net-file", "route-files", "additional-files", "load-state"

# Options that name files which SUMO reads.
FILES_READ = frozenset(
    {
        OF_NET, OF_ROUTES, OF_ADDITIONAL, OF_STATE, "weight-files", "astar.all-distances", "astar.landmark-distances",
        "phemlight-path", "device.fcd-replay.file", "device.fcd-replay.files",
    }
)  # fmt: skip

_OPTIONS = """
    begin seed collision.action collision.check-junctions collision.check-junctions.mingap collision.mingap-factor
    collision.stoptime default.action-step-length default.carfollowmodel default.departlane default.departspeed
    default.emergencydecel default.speeddev eager-insert emergency-insert emergencydecel.warning-threshold
    emissions.volumetric-fuel end extrapolate-departpos human-readable-time ignore-accidents ignore-junction-blocker
    ignore-route-errors insertion-checks intermodal-collision.action intermodal-collision.stoptime junction-taz
    keep-after-arrival lanechange.duration lanechange.overtake-right lateral-resolution load-state.offset
    load-state.remove-vehicles mapmatch.distance mapmatch.junctions mapmatch.taz max-depart-delay max-num-persons
    max-num-teleports max-num-vehicles meso-edgelength meso-ignore-lanes-by-vclass meso-interpolate-pos
    meso-jam-threshold meso-junction-control meso-junction-control.limited meso-lane-queue meso-ltm meso-minor-penalty
    meso-multi-queue meso-overtaking meso-recheck meso-tauff meso-taufj meso-taujf meso-taujj meso-tls-flow-penalty
    meso-tls-penalty mesosim no-internal-links overhead-wire.recuperation overhead-wire.solver
    overhead-wire.substation-current-limits parking.maneuver pedestrian.jupedsim.exit-tolerance
    pedestrian.jupedsim.model pedestrian.jupedsim.range-geometry-repulsion
    pedestrian.jupedsim.range-neighbor-repulsion pedestrian.jupedsim.step-length
    pedestrian.jupedsim.strength-geometry-repulsion pedestrian.jupedsim.strength-neighbor-repulsion pedestrian.model
    pedestrian.striping.dawdling pedestrian.striping.jamfactor pedestrian.striping.jamtime
    pedestrian.striping.jamtime.crossing pedestrian.striping.jamtime.narrow pedestrian.striping.legacy-departposlat
    pedestrian.striping.mingap-to-vehicle pedestrian.striping.reserve-oncoming
    pedestrian.striping.reserve-oncoming.junctions pedestrian.striping.reserve-oncoming.max
    pedestrian.striping.stripe-width pedestrian.striping.walkingarea-detail pedestrian.timegap-crossing
    persontrip.default.group persontrip.ride-public-line persontrip.taxi.waiting-time persontrip.transfer.car-walk
    persontrip.transfer.taxi-walk persontrip.transfer.walk-taxi persontrip.walk-opposite-factor persontrip.walkfactor
    phemlight-temperature phemlight-year precision precision.geo railsignal-moving-block railsignal.default-classes
    railsignal.max-block-length railsignal.moving-block.default-classes railsignal.moving-block.max-dist
    railway.max-train-length random-depart-offset replay-rerouting ride.stop-tolerance route-steps routing-algorithm
    scale scale-suffix slope-centered sloppy-insert startup-wait-threshold step-length step-method.ballistic
    thread-rngs threads
    time-to-impatience time-to-teleport time-to-teleport.bidi time-to-teleport.disconnected time-to-teleport.highways
    time-to-teleport.highways.min-speed time-to-teleport.railsignal-deadlock time-to-teleport.remove
    time-to-teleport.remove-constraint time-to-teleport.ride tls.actuated.detector-length tls.actuated.jam-threshold
    tls.actuated.show-detectors tls.all-off tls.delay_based.detector-range tls.yellow.min-decel use-stop-ended
    use-stop-started waiting-time-memory weight-attribute weights.minor-penalty weights.priority-factor
    weights.random-factor weights.random-factor.dynamic weights.reversal-penalty weights.separate-turns
    weights.tls-penalty weights.turnaround-penalty xml-validation xml-validation.net xml-validation.routes
"""

# Options of devices begin with the device's name, except the three that select the vehicles.
_DEVICES = """
    device.rerouting period pre-period adaptation-weight adaptation-steps adaptation-interval
        cch-update-threshold.factor cch-update-threshold.constant cch-ensemble threshold.factor threshold.constant
        invalidation with-taz mode init-with-loaded-weights threads synchronize railsignal bike-speeds
    person-device.rerouting period mode scope
    device.emissions begin period
    device.btreceiver range all-recognitions offtime
    device.btsender
    person-device.btsender
    person-device.btreceiver
    device.stationfinder rescueTime rescueAction reserveFactor emptyThreshold radius maxEuclideanDistance repeat
        chargeType waitForCharge minOpportunityDuration saturatedChargeLevel needToChargeLevel
        opportunisticChargeLevel replacePlannedStop maxDistanceToReplacedStop chargingStrategy checkEnergyForRoute
        maxChargePower
    device.battery track-fuel
    device.example parameter
    device.ssm measures thresholds trajectories range extratime mdrac.prt geo write-positions write-lane-positions
        write-na exclude-conflict-types
    device.toc manualType automatedType responseTime recoveryRate lcAbstinence initialAwareness mrmDecel
        dynamicToCThreshold dynamicMRMProbability mrmKeepRight mrmSafeSpot mrmSafeSpotDuration maxPreparationAccel
        ogNewTimeHeadway ogNewSpaceHeadway ogMaxDecel ogChangeRate useColorScheme
    device.driverstate initialAwareness errorTimeScaleCoefficient errorNoiseIntensityCoefficient
        speedDifferenceErrorCoefficient headwayErrorCoefficient freeSpeedErrorCoefficient
        speedDifferenceChangePerceptionThreshold headwayChangePerceptionThreshold minAwareness maximalReactionTime
    device.bluelight reactiondist mingapfactor
    device.fcd begin period radius
    person-device.fcd period
    device.elechybrid
    device.taxi dispatch-algorithm dispatch-algorithm.params dispatch-period dispatch-keep-unreachable
        idle-algorithm vclasses
    device.glosa range max-speedfactor min-speed add-switchtime use-queue override-safety ignore-cfmodel
    device.tripinfo
    device.vehroute
    device.friction stdDev offset
    device.fcd-replay consistency
"""


def _of_devices() -> set[str]:
    found, device = set[str](), ""
    for word in _DEVICES.split():
        if word.removeprefix("person-").startswith("device."):
            device = word
            found |= {f"{device}.{name}" for name in ("probability", "explicit", "deterministic")}
        else:
            found.add(f"{device}.{word}")
    return found


OPTIONS = frozenset(_OPTIONS.split()) | _of_devices()

# Removed options that name files for sumo-gui, and need no message.
FILES_OF_GUI = frozenset(
    {"gui-settings-file", "edgedata-files", "alternative-net-file", "selection-file", "gui-testing.setting-output"}
)

_ELEMENTS = """
     access actorConfig additional additionals allAttributes approaching assignment background bidiPredecessor bracket
    breakpoint busLine busStation busStop calibrator calibratorFlow calibratorLane carFollowing-ACC
    carFollowing-BKerner carFollowing-CACC carFollowing-CC carFollowing-Daniel1 carFollowing-EIDM carFollowing-IDM
    carFollowing-IDMM carFollowing-Krauss carFollowing-KraussOrig1 carFollowing-KraussPS carFollowing-KraussX
    carFollowing-NaSch carFollowing-PWagner2009 carFollowing-Rail carFollowing-SmartSK carFollowing-W99
    carFollowing-Wiedemann cfmVars chargingEvent chargingStation cityGates closing closingLaneReroute closingReroute
    colorScheme condition conflict connection connections container containerFlow containerPlans containers
    containerStop containerStops crossing data dataInterval datas dataSet dataSettings deadlock decal delay delete
    demand destProbReroute detectorDefinition detectors detEntry detExit device dispatcher driveWay e1Detector
    e2Detector e3Detector edge edgeControl edgeData edgeData-edge edgeFollowDetector edgeRelation edges entrance entry
    entryExitDetector error event flow flowJunctions flowRoute flows flowState flowTAZs flowWithRoute foeInsertion
    frequency fromEdge function general include inductionLoop insertionOrder insertionPredecessor instantInductionLoop
    internalLane interval jamTime join joinExclude junction junctions jupedsim jupedsim.obstacle
    jupedsim.walkable_area lane laneAreaDetector laneData laneType legend light link location member meso metadata
    motionState multiLaneAreaDetector nd neigh net network node odPair opengl opening overheadWire overheadWireClamp
    overheadWireSegment overtakingReroute param parameters parkingArea parkingAreaReroute person personFlow
    personPlans persons personStops personTrip personTrips phase poi poiGeo poiLane pois poly polygonType polys
    population predecessor preference prohibition ptLine railSignalConstraints railSignalConstraintTracker relation
    rem request rerouter rerouterSymbol restriction revStations ride rides rngLane rngState rootFile roundabout route
    route-alternatives routeDistribution routeEmbedded routeProbe routeProbReroute routeRef routes routingEngine
    scalingScheme scheme school schools segment shapes sink snapshot source space split station stationReroute
    stations step stop stopBusStop stopChargingStation stopContainer stopContainerStop stopLane stopOffset
    stopParkingArea stopPerson stoppingPlaces stops stopTrainStop street subDriveWay tag taz tazRelation TAZs tazSink
    tazSource timedEvent timeSlice timestep tlLogic toEdge tracker tractionSubstation trafficLight trainStop
    trajectories tranship tranships transport transportables transports trip tripJunctions tripTAZs type types
    vaporizer variableSpeedSign variableSpeedSignSymbol vehicle vehicles vehicleTransfer vehicleWithRoute
    viaProbReroute view3D viewport viewsettings vType vTypeDistribution vTypeProbe vTypeRef walk walkingArea walks
    WAUT wautJunction wautSwitch way waypoint waypointBusStop waypointChargingStation waypointContainerStop
    waypointLane waypointParkingArea waypointTrainStop wires workHours
"""

ELEMENTS = frozenset(_ELEMENTS.split())

_ATTRIBUTES = """
    accel acceleration accelerationLat accelerationVec acceptedBadges action actionStepLength active actorConfig
    actType actualBatteryCapacity adaptFactor adaptTime aggregate airDragCoefficient allow alphaCircuitSolver amount
    angle apparentDecel applyDriverState apProb arrival arrivalDelay arrivalEdge arrivalLane arrivalPos arrivalPosLat
    arrivalPosRandomized arrivalSpeed arrivalSpeedBraking arrivalTime arrivalTimeBraking arrived averageSpeed
    avoidOverlap begin beginAge bidi bikeLaneWidth bikeSpeed blockTime boardingDuration boardingFactor busStop c1
    capacity carFollowModel carFollowModel.ignoreIDs carFollowModel.ignoreTypes carPreference carRate carriageDoors
    carriageGap carriageLength cc1 cc2 cc3 cc4 cc5 cc6 cc7 cc8 cc9 ccAccel ccDecel ccoolness center centerView centerX
    centerY centerZ changeLeft changeRight chargeCurveTable chargeDelay chargeInTransit chargeLevel chargeLevelTable
    chargeType chargingBegin chargingEnd chargingStation chargingStationId chargingStatus chargingSteps check
    checkLaneFoesAll checkLaneFoesRoundabout childrenAgeLimit circuitVoltage clamps close closing CO CO2 CO2_abs
    CO2_normed CO2_perVeh CO_abs CO_normed CO_perVeh collision collisionAvoidanceGainGap collisionAvoidanceGainGapDot
    collisionAvoidanceGainSpace collisionAvoidanceGainSpeed collisionAvoidanceOverride collisionMinGapFactor color
    commandPosix conditions constantPowerIntake constraints constSpacing cont containerCapacity containerNumber
    containersPerHour containerStop containerTriggered contPos controlledInner convBoundary cost costs count crossing
    crossingEdges current currentLimit curveIntegration curveResistance customers customShape cycleTime dataSet decel
    default defaultProbability defaultVTypeModified defer delay delta density depart departed departEdge departLane
    departPos departPosLat departSpeed departureVariation desAccelProfile desiredMaxSpeed destination detectors
    detectPersons deterministic device device.btreceiver device.toc dir disallow discard distance done driverState
    duration earliestEnd earlyTarget eclass edge edgeLength edges edgesWithin efficiency electricity electricity_abs
    electricity_normed electricity_perVeh emergencyDecel emissionClass end endAge ended endOffset endPos energyCharged
    energyChargedInTransit energyChargedStopped energyConsumed entered entering entryPos entryTime epsilonacc
    estimation eventTime exceptions excludeEmpty exitTimes expectArrival expected expectedContainers extension fill
    finalTarget flatbedD flatbedH flatbedKa flatbedKp flatbedKv flexArrival flow flowParameter foes footDistanceLimit
    forbiddenInnerLanes forceSize freeTimeActivityRate freq friction friendlyPos fringe from fromBusStop
    fromChargingStation fromContainerStop fromJunction fromLane fromLaneID fromLonLat fromParkingArea fromRoute
    fromTaz fromTrainStop fromXY frontElement frontSurfaceArea fuel fuel_abs fuel_normed fuel_perVeh function
    gapClosingControlGainGap gapClosingControlGainGapDot gapClosingControlGainSpace gapClosingControlGainSpeed
    gapControlGainGap gapControlGainGapDot gapControlGainSpace gapControlGainSpeed gearEfficiency gearRatio
    generateWalks geo geoShape group guiShape HC HC_abs HC_normed HC_perVeh height hour households icon id idAfter
    idBefore idSegmentEndClamp idSegmentStartClamp impatience incLanes incoming incomingTraffic index indirect
    inhabitants insertionChecks insertionControl intended internalBatteryResistance internalJunctionsVehicleWidth
    internalMomentOfInertia interpolated intLanes isBidi isRoundabout jamThreshold jerkmax jmAdvance jmAllwayStopWait
    jmCrossingGap jmDriveAfterRedTime jmDriveAfterYellowTime jmDriveRedSpeed jmExtraGap jmIgnoreFoeProb
    jmIgnoreFoeSpeed jmIgnoreJunctionFoeProb jmIgnoreKeepClearTime jmSigmaMinor jmStoplineCrossingGap jmStoplineGap
    jmStoplineGapMinor jmStopSignWait jmTimegapMinor join jump jumpUntil junctionControl junctionCornerDetail
    junctionHigherSpeed junctionID junctionLinkDetail junctionModel.ignoreIDs junctionModel.ignoreTypes
    junctionsEndpointShape junctionsMinimalShape k keepClear key kp laborDemand lambda lane laneChangedFrom
    laneChangedTo laneChangeModel laneDensity laneLength lanes lanesCount last lat latAlignment latestEnd layer
    lcAccelLat lcAssertive lcContRight lcCooperative lcCooperativeHelpThreshold lcCooperativeHelpTime
    lcCooperativeMinSpeed lcCooperativeRoundabout lcCooperativeSpeed lcExperimental1 lcImpatience lcKeepRight
    lcKeepRightAcceptanceTime lcLaneDiscipline lcLookaheadLeft lcMaxDistLatStanding lcMaxSpeedLatFactor
    lcMaxSpeedLatStanding lcOpposite lcOvertakeDeltaSpeedFactor lcOvertakeRight lcPushy lcPushyGap lcSigma lcSpeedGain
    lcSpeedGainLookahead lcSpeedGainRemainTime lcSpeedGainRight lcSpeedGainUrgency lcState lcState2 lcStateBase
    lcStrategic lcStrategicLookahead lcSublane lcTimeToImpatience lcTurnAlignmentDistance leaderGap leaderID
    leaderSpeed left lefthand length limit limitTurnSpeed line lines lineWidth linkIndex linkIndex2 loaderTime loading
    loadingDuration local locomotiveLength lon main maneuverAngleTimes mass massFactor maxAccelProfile maxCharge
    maxDur maxEfficiency maximumBatteryCapacity maximumChargeRate maximumPower maximumRecuperationPower
    maximumRecuperationTorque maximumSpeed maximumTorque maxPower maxSpeed maxSpeedLat maxTraction maxTraveltime
    maxTripDuration maxvehpreview maxWidth Mbegin meanTimePerKmInCity mesoTLS Mflatness minCharge minDur minEfficiency
    minGap minGapLat minorPenalty minPower minSamples minSaving minWidth modes modificationStatusNotForPrinting name
    nArgs netOffset next nextEdges noCommonAttributes node nodes noise nominalBatteryVoltage NOx NOx_abs NOx_normed
    NOx_perVeh number numEdges numLanes occupancy odometer off offset omegaN onDemand oneway onRoad openEntry opening
    opposite optional origBoundary origin outgoing outgoingTraffic outlineShape overheadWireChargingPower
    overheadWireId overheadWireSegment overlapDensity overlapTraveltime overtaking parameters parent parking
    parkingArea parkingBadges parkingLength partialCharge pass pastBikeSpeed pastSpeed pathStopIndex peopleNbr perHour
    period permitted personCapacity personNumber personsPerHour phase phi planGeometryEndPos planGeometryStartPos
    ploegH ploegKd ploegKp PMx PMx_abs PMx_normed PMx_perVeh poisson population pos posLat posOnLane power
    powerLossMap prefer prefix priority probabilities probability procedure programID prohibited prohibitor
    projParameter proportion propulsionEfficiency queue radialDragCoefficient radius rail rate rectangularLaneCut
    recuperationEfficiency recuperationEfficiencyByDecel recuperationEnabled red ref reference refId refTime remove
    repeat replacedAtTime replacedOnIndex repno request requestSize reroute resCoef_constant resCoef_linear
    resCoef_quadratic reservable reservations reset resistanceTable response retirementAgeLimit rightOfWay
    roadsideCapacity roeckl_numerator roeckl_numerator_sharp roeckl_offset roeckl_offset_sharp roeckl_sharp_radius
    rollDragCoefficient rotatingMass roundabout route routeHandler routeLength routeProbe routes routingType
    sampledSeconds saveConditions saveDetectors savings scale security segment segments selected shape shapeEnd
    shapeStart shiftLaneIndex show shutOffAutoDuration shutOffStopDuration sidewalkWidth siding sigma sigmaerror
    sigmagap sigmaleader sigmaStep signals size slope source spacing speed speedControlGain speedControlGainCACC
    speedControlMinGap speedDev speedFactor speedFactorPremature speedLat speedRelative speedTable speedThreshold
    speedThresholdRelative speedVec split splitByType spreadType stage started startPos startProg startTime
    startupDelay state stepping stopIndex stopOException stopOffset stoppingTreshold stopTime style substationId
    synchron taccmax tag targetLanes tau tauCACCToACC tauEngine tauff taufj taujf taujj tauLast tazCentroid teleported
    terminate threshold time timeLoss timeStopped timeThreshold timeToTeleport timeToTeleportBidi tl tlLayout
    tlsFlowPenalty tlsIgnoreInternalJunctionJam tlsPenalty tlType tmp1 tmp2 tmp3 tmp4 tmp5 to toJunction toLane
    toLaneID toLonLat totalEnergyCharged totalEnergyChargedIntoVehicle totalEnergyConsumed totalEnergyRegenerated
    totalPower toTaz toXY tPersDrive tPersEstimate tpreview trackVehicles tractionSubstationId tractionTable trainStop
    trainType traveltime treaction triggered tripId type uncontrolled unemploymentRate uniformRandomTraffic until
    usedEnded v value vaporized vClass vClasses vehdynamics vehext vehicle vehicleClass vehicleMass vehicles
    vehsPerHour version via viaJunctions viaLonLat viaXY visibility visible voltage voltageSource vTypes waiting
    waitingCount waitingTime walkFactor walkingareas wautID weight wheelRadius width widthResolution wireClampEnd
    wireClampLaneEnd wireClampLaneStart wireClampStart wireResistivity withInternal workPosition writeAttributes x xi
    y yellow z zoom
"""

ATTRIBUTES = frozenset(_ATTRIBUTES.split())

NOWHERE = "NUL"  # SUMO's name, on every system, for discarded output

# Attributes that name a file to read, and the elements whose `file` is one.
READ = frozenset({"href", "imgFile", "osgFile", "edgesFile"})
READ_BY = frozenset({"rerouter", "variableSpeedSign", "calibrator"})
# Attributes that name a file to write; `file` is one on all other elements.
WRITTEN = frozenset({"output", "dest"})

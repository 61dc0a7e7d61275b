# regents in a container, from the wheel that `make wheel` leaves in dist/:
#   make wheel && docker build -t regents .
#   docker run --rm -v "$PWD:/work" regents attack -c shipped:merge --planner idm -o suite
FROM python:3.12-slim

# What SUMO's wheel links to and does not bring (regents_cosim/simulators/sumo/process.py).
RUN apt-get update \
    && apt-get install --yes --no-install-recommends libgl1 libx11-6 libxext6 libxrender1 libatomic1 libexpat1 \
    && rm -rf /var/lib/apt/lists/*

COPY dist/*.whl /tmp/
RUN pip install --no-cache-dir "$(ls /tmp/*.whl)[test]" && rm /tmp/*.whl

RUN useradd --create-home tester
USER tester
WORKDIR /work
ENTRYPOINT ["regents"]
CMD ["--help"]

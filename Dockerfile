# Debian or alike, with Python 3.11, its venv module and pip.
ARG BASE_IMAGE=python:3.11-slim

FROM ${BASE_IMAGE} AS dependencies
# Where the CPU-only torch lies: a page of links, or a folder.
ARG WHEEL_INDEX=https://download.pytorch.org/whl/cpu/torch/
# The base's pip fills it from outside: it goes into the image whole, and pip would go along.
RUN python3 -m venv --without-pip /opt/venv
WORKDIR /src
# Only what names the dependencies, so that an edit of the source does not install them again.
COPY pyproject.toml .
# PyPI has the same torch with gigabytes of CUDA: "+cpu" makes pip fail rather than take that one.
# Its headers and tests go; of its programs its import asks for the manager.
RUN python3 -c "import tomllib; print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['dependencies'], sep='\n')" \
    | sed 's/^torch==.*/&+cpu/' > requirements.txt \
    && pip --python /opt/venv/bin/python install --no-cache-dir --find-links "${WHEEL_INDEX}" -r requirements.txt \
    && cd /opt/venv/lib/python3*/site-packages/torch && rm -r include test \
    && find bin -type f ! -name torch_shm_manager -delete
# Everybody's tests go, too; numpy.testing uses some of numpy's.
RUN cd /opt/venv/lib/python3*/site-packages \
    && find . -path ./numpy -prune -o -type d -name tests -prune -exec rm -r {} +

FROM dependencies AS package
# `ray` brings what a cluster needs beside.
ARG EXTRA=""
COPY . .
RUN pip --python /opt/venv/bin/python install --no-cache-dir --prefix /package ".${EXTRA:+[${EXTRA}]}" \
    && mv /package/lib/python3*/site-packages/model_store /models

FROM ${BASE_IMAGE}
ARG BASE_IMAGE
ARG REVISION=unknown
LABEL org.opencontainers.image.title="Breakaway" \
    org.opencontainers.image.description="Plans control through dry friction and stiction, over HTTP" \
    org.opencontainers.image.version="0.1.0" \
    org.opencontainers.image.revision="${REVISION}" \
    org.opencontainers.image.base.name="${BASE_IMAGE}"
COPY --from=dependencies /opt/venv /opt/venv
COPY --from=package /package /opt/venv
COPY --from=package /models /models
# Any user may run it, also one without a home; nothing is written but what is asked for.
ENV PATH=/opt/venv/bin:${PATH} HOME=/tmp PYTHONDONTWRITEBYTECODE=1 \
    BREAKAWAY_HOST=0.0.0.0 BREAKAWAY_MODEL_STORE=/models
# Kernels for x86-64-v3 and v4, whichever runs this; another processor's first start compiles its own.
RUN NUMBA_CACHE_DIR=/opt/venv/share/breakaway/kernels python -m app.serving.kernels
# By number: Kubernetes' runAsNonRoot does not trust a name. OpenShift takes another, of group 0.
USER 10001:0
EXPOSE 8000
HEALTHCHECK --interval=10s --timeout=5s --start-period=60s CMD ["python", "-m", "app.health_check"]
ENTRYPOINT ["breakaway"]
CMD ["serve"]
